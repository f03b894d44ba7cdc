"""Wrong robots and worlds: one sentence that names what is wrong, exit status 2, nothing written."""

from pathlib import Path

import pytest

from anm_mj.cli.main import main
from tests.robots import ROVER_XML

MODELS = Path(__file__).resolve().parents[1] / "robot" / "models"
ROOM = (
    '<geom name="floor" type="plane" size="3 3 1"/>'
    '<geom name="north" type="box" size="3 0.05 1.25" pos="0 3 1.25"/>'
    '<geom name="south" type="box" size="3 0.05 1.25" pos="0 -3 1.25"/>'
)
WORLDS = {
    "missing include": ('<include file="gone.xml"/>', "", "gone.xml"),
    "include of itself": ('<include file="in.xml"/>', "", "in.xml"),
    "include cycle": ('<include file="other.xml"/>', "", "cannot compile"),
    "geom without size": (f'{ROOM}<geom type="box"/>', "", "size"),
    "geom of an unknown type": (f'{ROOM}<geom type="cube" size="1 1 1"/>', "", "cube"),
    "missing mesh file": (ROOM, '<asset><mesh name="m" file="gone.stl"/></asset>', "gone.stl"),
    "unreadable mesh file": (ROOM, '<asset><mesh name="m" file="bad.stl"/></asset>', "bad.stl"),
    "flat mesh that collides": (f'{ROOM}<geom type="mesh" mesh="m"/>',
                                '<asset><mesh name="m" vertex="0 0 0 1 0 0 0 1 0"/></asset>', "cannot compile"),
    "mesh of another name": (f'{ROOM}<geom type="mesh" mesh="none"/>', "", "none"),
    "name used twice": (f'{ROOM}<geom name="floor" size="1"/>', "", "floor"),
    "free body without mass": (f"{ROOM}<body><freejoint/></body>", "", "mass"),
    "free body in a body": (f'{ROOM}<body><body><freejoint/><geom size="1"/></body></body>', "", "free joint"),
    "material of another name": (f'{ROOM}<geom size="1" material="none"/>', "", "none"),
    "default class of another name": (f'{ROOM}<geom class="none" size="1"/>', "", "none"),
    "missing texture file": (ROOM, '<asset><texture name="t" type="2d" file="t.png"/></asset>', "t.png"),
    "unreadable texture file": (ROOM, '<asset><texture name="t" type="2d" file="bad.png"/></asset>', "bad.png"),
    "texture without a size": (ROOM, '<asset><texture name="t" type="2d" builtin="flat"/></asset>', "cannot compile"),
    "height field without data": (ROOM, '<asset><hfield name="h" size="1 1 1 1"/></asset>', "cannot compile"),
    "key frame of another size": (ROOM, '<keyframe><key qpos="1 2 3"/></keyframe>', "qpos"),
    "actuator on nothing": (ROOM, '<actuator><motor joint="none"/></actuator>', "none"),
    "attached model that is missing": (f'{ROOM}<body><attach model="none" prefix="a"/></body>', "", "cannot compile"),
    "size that is no number": (f'{ROOM}<geom type="sphere" size="nan"/>', "", "in.xml"),
    "negative size": (f'{ROOM}<geom type="sphere" size="-1"/>', "", "cannot compile"),
    "unknown element": (f"{ROOM}<wall/>", "", "wall"),
    "unknown compiler setting": (ROOM, '<compiler angle="grad"/>', "grad"),
    "no geoms": ("", "", "nothing that is drawn"),
    "lights only": ('<light pos="0 0 3"/>', "", "nothing that is drawn"),
    "geoms in hidden groups only": (ROOM.replace("<geom", '<geom group="4"'), "", "--groups"),
    "one small ball": ('<geom size="0.1"/>', "", "m2 to move"),
    "walls without a floor": (ROOM.replace('type="plane" size="3 3 1"', 'type="box" size="0.1 3 1.25" pos="3 0 1.25"'),
                              "", "has no floor"),
    "centimetres": ('<geom type="box" size="300 300 5"/><geom type="box" size="300 5 99" pos="0 9 99"/>', "", "500 m"),
    "no end": (None, "<mujoco><worldbody>", "cannot compile"),
    "another root": (None, "<sdf/>", "no format"),
    "nothing": (None, "", "no format"),
    "nothing but the root": (None, "<mujoco/>", "nothing that is drawn"),
    "bytes": (None, "\x00\x01\x02", "no format"),
}  # fmt: skip
ROBOTS = {
    "one wheel": ([('name="right_wheel_joint" axis', 'name="r" range="-9 9" axis'), ("right_wheel_joint", "r")],
                  [], "one driven wheel"),
    "no wheels": ([("left_wheel_joint", "a"), ("right_wheel_joint", "b"),
                   ("<motor name=\"left_motor\" joint=\"a\" gear=\"5\"/>", ""),
                   ("<motor name=\"right_motor\" joint=\"b\" gear=\"5\"/>", "")], [], "has no wheels"),
    "wheels with a range": ([('left_wheel_joint" axis', 'left_wheel_joint" range="-90 90" axis')], [], "degrees only"),
    "wheels of different size": ([("-0.115 -0.05 -0.05", "-0.115 -0.05 -0.02")], [], "must"),
    "wheels without a common axle": ([("-0.115 -0.05 -0.05", "-0.115 0.03 -0.05")], [], "share one level axle"),
    "tilted axles": ([('axis="1 0 0"', 'axis="1 0 0.2"')], [], "share one level axle"),
    "sliding wheel": ([('name="left_wheel_joint"', 'name="left_wheel_joint" type="slide"')], [], "no hinge"),
    "wheel without a geom": ([('axis="1 0 0"/>\n        <geom class="wheel"/>',
                               'axis="1 0 0"/>\n        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>')],
                             [], "has no geom"),
    "wheels on two bodies of the world": ([('<body name="starboard" pos="0.115 -0.05 -0.05">',
                                            '</body><body name="starboard" pos="1.115 1.95 0.04">'),
                                           ('</body>\n    <body name="ball"', '<body name="ball"')],
                                          [], "different bodies of the world"),
    "wheels above the caster": ([('pos="0 0.11 -0.075"', 'pos="0 0.11 -0.125"')], [], "cm below the wheels"),
    "camera in the body": ([('pos="0.02 0.10 0.11"', 'pos="0 0 0"')], [], "inside the robot's body"),
    "camera on a wheel": ([('<camera name="eye" pos="0.02 0.10 0.11" xyaxes="1 0 0 0 0 1" fovy="60"/>', ""),
                           ('"1 0 0"/>', '"1 0 0"/><camera name="eye" pos="-0.2 0 0" xyaxes="1 0 0 0 0 1"/>')],
                          [], "turns with a wheel"),
    "camera that looks back": ([('xyaxes="1 0 0 0 0 1"', 'xyaxes="-1 0 0 0 0 1"')], [], "does not look forward"),
    "camera that looks down": ([('xyaxes="1 0 0 0 0 1"', 'xyaxes="1 0 0 0 1 0"')], [], "looks 90 degrees down"),
    "camera below the floor": ([('pos="0.02 0.10 0.11"', 'pos="0.02 0.20 -0.2"')], [], "above the floor"),
    "camera above all rooms": ([('pos="0.02 0.10 0.11"', 'pos="0.02 0.10 9"')], [], "above the floor"),
    "fisheye": ([('fovy="60"', 'fovy="175"')], [], "field of view of 175"),
    "camera that follows": ([('fovy="60"', 'mode="track" fovy="60"')], [], "eye, which follow"),
    "orthographic camera": ([('fovy="60"', 'projection="orthographic" fovy="2"')], [], "orthographic"),
    "no camera": ([('<camera name="eye" pos="0.02 0.10 0.11" xyaxes="1 0 0 0 0 1" fovy="60"/>', "")],
                  [], "model.camera_pose"),
    "negative mass": ([('size="0.04 0.012"', 'size="0.04 0.012" mass="-1"')], [], "mass"),
    "missing mesh file": ([("<default>", '<asset><mesh name="m" file="gone.stl"/></asset><default>')], [], "gone.stl"),
    "missing include": ([("<default>", '<include file="gone.xml"/><default>')], [], "gone.xml"),
    "include of itself": ([("<default>", '<include file="in.xml"/><default>')], [], "in.xml"),
    "no end": ([("</mujoco>", "")], [], "cannot read"),
    "another root": ([("<mujoco", "<mjc")], [], "cannot read"),
    "far too large": ([('size="0.10 0.13 0.04"', 'size="10 13 0.04"'), ("0.02 0.10 0.11", "0.02 14 0.11")],
                      [], "unit is the metre"),
    "wheel of another name": ([], ["model.left_wheel=port"], 'no hinge "port"'),
    "camera of another name": ([], ["model.camera=lens"], 'no camera "lens"'),
    "key frame of another name": ([], ["model.keyframe=sit"], 'no key frame "sit"'),
    "skid steer with two wheels": ([], ["model.skid_steer=true"], "skid_steer is set"),
    "camera pose of three numbers": ([], ["model.camera_pose=1,2,3"], "x,y,z,pitch,fovy"),
    "camera pose in the body": ([], ["model.camera_pose=0,0,0.09,0,60"], "inside the robot's body"),
    "unknown setting": ([], ["model.wheels=4"], "model.wheels"),
}  # fmt: skip


def refuse(arguments: list[str], word: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Run a command and check that it refuses."""
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    assert main(arguments) == 2
    said = capsys.readouterr()
    sentence = " ".join(said.err.split())
    assert sentence.count("anm-mj: ") == 1
    assert word.lower() in sentence.lower()
    assert "Traceback" not in said.out + said.err
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before


def test_there_are_sixty() -> None:
    assert len(WORLDS) + len(ROBOTS) >= 60


@pytest.mark.parametrize("name", WORLDS)
def test_wrong_worlds_are_refused(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ANM_MJ_SCENES", str(tmp_path / "scenes"))
    body, more, word = WORLDS[name]
    text = more if body is None else f"<mujoco>{more}<worldbody>{body}</worldbody></mujoco>"
    Path("in.xml").write_text(text)
    Path("other.xml").write_text('<mujoco><include file="in.xml"/></mujoco>')
    Path("bad.stl").write_bytes(b"solid nothing")
    Path("bad.png").write_bytes(b"\x89PNG no picture")
    refuse(["scene", "import", "in.xml", "out"], word, tmp_path, capsys)


@pytest.mark.parametrize("name", ROBOTS)
def test_wrong_robots_are_refused(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    changes, settings, word = ROBOTS[name]
    text = ROVER_XML.read_text()
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    Path("in.xml").write_text(text)
    given = [word for setting in settings for word in ("--set", setting)]
    refuse(["robot", "check", "in.xml", *given], word, tmp_path, capsys)
