"""Robots, worlds, environments and machines of the same reports as the recorded sequences."""

import copy
import json
import pickle
import pwd
import sys
import threading
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
import trimesh

import anm_mj.environments  # noqa: F401  Registers the environment.
from anm_mj.cli.main import main
from anm_mj.errors import RenderError, RobotError, SceneError, TaskError
from anm_mj.robot.robot_config import RobotConfig
from anm_mj.scene.importing.readers.gazebo import read_gazebo
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.source_formats import find_format
from anm_mj.sim.describe_file import describe_file

MOUNTED = RobotConfig(camera_pose="0.1,0,0.8,0,90")
_MASS = '<inertial><mass value="{}"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>'


def urdf(mesh, more=""):
    """A robot of two wheels whose body is a mesh."""
    wheels = "".join(
        f'<joint name="{side}_wheel_joint" type="continuous"><parent link="base"/><child link="{side}_wheel"/>'
        f'<origin xyz="0 {y} -0.04"/><axis xyz="0 1 0"/></joint><link name="{side}_wheel">{_MASS.format(0.2)}'
        '<collision><origin rpy="1.5708 0 0"/><geometry><cylinder radius="0.04" length="0.02"/></geometry></collision>'
        "</link>"
        for side, y in (("left", 0.15), ("right", -0.15))
    )
    shape = f'<geometry><mesh filename="{mesh}"{more}/></geometry>'
    return (
        f'<robot name="bot"><link name="base">{_MASS.format(5)}<visual>{shape.replace("base.", "shown.")}</visual>'
        f"<collision>{shape}</collision></link>{wheels}</robot>"
    )


def package(tmp_path, name="my_bot"):
    """The folder for URDF files of a package ``my_bot``, whose box is 0.3 x 0.28 x 0.1 m."""
    folder = tmp_path / name
    for below in ("urdf", "meshes"):
        (folder / below).mkdir(parents=True)
    (folder / "package.xml").write_text("<package><name>my_bot</name></package>")
    box = trimesh.creation.box((0.3, 0.28, 0.1))
    for ending in ("stl", "dae"):
        box.export(folder / "meshes" / f"base.{ending}")
    return folder / "urdf"


def b15_urdf(tmp_path, mesh, folder="my_bot", more=""):
    path = package(tmp_path, folder) / "bot.urdf"
    path.write_text(urdf(mesh.format(folder=path.parents[1]), more))
    return path


@pytest.mark.parametrize(
    ("mesh", "folder"),
    [
        ("package://my_bot/meshes/base.stl", "my_bot"),
        ("package://my_bot/meshes/base.stl", "my_bot-main"),
        ("model://my_bot/meshes/base.dae", "my_bot"),
        ("file://{folder}/meshes/base.stl", "my_bot"),
        ("../meshes/base.dae", "my_bot"),
    ],
)
def test_meshes_of_a_urdf_are_found_and_read(tmp_path, mesh, folder):
    robot = describe_file(b15_urdf(tmp_path, mesh, folder), MOUNTED)
    assert robot.wheel_joints == ("left_wheel_joint", "right_wheel_joint")
    assert robot.footprint.z_max_m == pytest.approx(0.13, abs=2e-3)
    assert robot.body_radius_m == pytest.approx(np.hypot(0.15, 0.14), abs=0.02)


def test_packages_of_ros_are_searched_and_scales_apply(tmp_path, monkeypatch):
    package(tmp_path / "ws" / "share")
    (tmp_path / "a" / "b" / "c" / "d").mkdir(parents=True)
    path = tmp_path / "a" / "b" / "c" / "d" / "bot.urdf"
    path.write_text(urdf("package://my_bot/meshes/base.stl", ' scale="1 1 2"'))
    with pytest.raises(RobotError, match=r"'package://my_bot/meshes/base.stl', which is not found.*ANM_MJ_ROBOTS"):
        describe_file(path, MOUNTED)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ws"))
    assert describe_file(path, MOUNTED).footprint.z_max_m == pytest.approx(0.18, abs=2e-3)


def test_a_urdf_with_macros_is_expanded_or_refused(tmp_path, monkeypatch):
    path = package(tmp_path) / "bot.urdf.xacro"
    path.write_text("<robot/>")
    monkeypatch.setitem(sys.modules, "xacro", None)
    with pytest.raises(RobotError, match=r"install xacro .* or expand it with `xacro bot.urdf.xacro > bot.urdf`"):
        describe_file(path)
    made = SimpleNamespace(toxml=lambda: urdf("package://my_bot/meshes/base.stl"))
    monkeypatch.setitem(sys.modules, "xacro", SimpleNamespace(process_file=lambda path: made))
    assert describe_file(path, MOUNTED).name == "bot"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<robot", "cannot be read"),
        (urdf("flat.obj"), "has no volume"),
        (urdf("none.stl"), "'none.stl', which is not found"),
        (urdf("text.stl"), "text.stl"),
    ],
)
def test_what_is_wrong_with_a_urdf_is_one_sentence(tmp_path, text, said):
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "text.stl").write_text("nothing")
    (tmp_path / "bot.urdf").write_text(text)
    with pytest.raises(RobotError, match=said):
        describe_file(tmp_path / "bot.urdf", MOUNTED)


def _box(pose, size, name):
    shape = f"<geometry><box><size>{size}</size></box></geometry>"
    return f"<visual name='{name}'><pose>{pose}</pose>{shape}</visual>"


def b22_merge(folder, include, attributes="", cupboard="<pose relative_to='mount'/>"):
    (folder / "walls").mkdir()
    sides = _box("2 2 -0.05 0 0 0", "4 4 0.1", "floor") + _box("-0.05 2 1.25 0 0 0", "0.1 4 2.5", "w")
    (folder / "walls" / "model.sdf").write_text(
        f"<sdf version='1.9'><model name='walls'{attributes}><static>true</static><link name='l'>{sides}</link>"
        "<frame name='mount' attached_to='__model__'><pose>3 3 0 0 0 0</pose></frame>"
        "<frame name='corner'><pose>1 0 0 0 0 1.5707963267948966</pose></frame></model></sdf>"
    )
    (folder / "walls" / "model.config").write_text("<model><sdf version='1.9'>model.sdf</sdf></model>")
    link = f"<link name='cupboard'>{cupboard}{_box('0 0 0.5 0 0 0', '0.6 0.6 1', 'c')}</link>"
    world = folder / "merge.world"
    world.write_text(
        f"<sdf version='1.9'><world name='w'><model name='room'><include merge='true'><uri>model://walls</uri>{include}"
        f"</include>{link}</model></world></sdf>"
    )
    return world


@pytest.mark.parametrize(
    ("include", "attributes", "centre"),
    [
        ("", "", (3.0, 3.0)),
        ("<name>w2</name><pose>10 0 0 0 0 1.5707963267948966</pose>", "", (7.0, 3.0)),
        ("<placement_frame>corner</placement_frame><pose>0 0 0 0 0 0</pose>", "", (3.0, -2.0)),
        ("", " placement_frame='corner'", (3.0, -2.0)),
    ],
)
def test_a_model_is_merged_into_another(tmp_path, include, attributes, centre):
    parsed = read_gazebo(b22_merge(tmp_path, include, attributes), [tmp_path], ImportReport())
    cupboard = next(part for part in parsed.submeshes if part.name.endswith("_c"))
    assert np.allclose(cupboard.vertices_m.mean(axis=0)[:2], centre, atol=1e-6)
    # The walls keep their place to the cupboard.
    floor = next(part for part in parsed.submeshes if part.name.endswith("_floor"))
    apart = np.linalg.norm(floor.vertices_m.mean(axis=0)[:2] - centre)
    assert apart == pytest.approx(np.sqrt(2.0), abs=1e-6)


def test_a_frame_that_no_merged_model_has_is_named(tmp_path):
    world = b22_merge(tmp_path, "", cupboard="<pose relative_to='shelf'/>")
    with pytest.raises(SceneError, match="relative to 'shelf', which is not there"):
        read_gazebo(world, [tmp_path], ImportReport())


def test_an_environment_says_that_it_stays_in_its_thread_and_is_not_copied():
    env = gymnasium.make("AnmMj/Explore-v0", scene="room", image_px=32, num_steps=5).unwrapped
    pickle.loads(pickle.dumps(copy.deepcopy(env)))
    env.reset(seed=0)
    for copied in (copy.deepcopy, pickle.dumps):
        with pytest.raises(TaskError, match="cannot be copied or pickled after its first reset"):
            copied(env)
    said = []

    def step():
        try:
            env.step(1)
        except RenderError as err:
            said.append(str(err))

    thread = threading.Thread(target=step)
    thread.start()
    thread.join()
    # Ray casters and OSMesa render in any thread.
    assert all("belongs to the thread that made it" in one for one in said)
    env.step(1)
    env.close()
    copy.deepcopy(env)


def test_no_home_is_needed(monkeypatch, capsys):
    def nobody(uid):
        raise KeyError(uid)

    monkeypatch.delenv("HOME")
    monkeypatch.setattr(pwd, "getpwuid", nobody)
    assert main(["scene", "list"]) == 0
    assert "room" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "said"),
    [("room.usdz", "import it in Blender"), ("room.splat", "Gaussian splats"), ("room.e57", "a point cloud")],
)
def test_what_has_no_surface_is_refused_with_a_way_out(tmp_path, name, said):
    (tmp_path / name).write_bytes(b"PK\x03\x04")
    with pytest.raises(SceneError, match=f"{said}.*and import that"):
        find_format(tmp_path / name)


@pytest.mark.slow
def test_a_route_graph_is_what_the_route_server_loads(tmp_path):
    run, out = str(tmp_path / "run"), tmp_path / "out"
    assert main(["explore", "home", "--steps", "40", "--preset", "quick", "--out", run]) == 0
    assert main(["export", run, "--format", "route", "--out", str(out)]) == 0
    features = json.loads((out / "route.geojson").read_text())["features"]
    nodes = [one["properties"]["id"] for one in features if one["geometry"]["type"] == "Point"]
    edges = [one["properties"] for one in features if one["geometry"]["type"] != "Point"]
    assert nodes
    assert len({*nodes} | {edge["id"] for edge in edges}) == len(nodes) + len(edges)
    ways = {(edge["startid"], edge["endid"]) for edge in edges}
    assert ways == {(end, start) for start, end in ways}
    assert {node for way in ways for node in way} <= {*nodes}
