import tomllib

import mujoco
import numpy as np
import pytest

from anm_mj.errors import SceneError
from anm_mj.scene.importing.import_scene import import_scene
from tests.scene.importing.readers.mjcf.worlds import room_xml, write_world


def test_up_is_against_gravity(tmp_path):
    turned = '<option gravity="0 -9.81 0"/>'
    room = f'<body euler="-90 0 0">{room_xml()}<geom type="box" size="0.2 0.3 0.4" pos="1 2 0.4"/></body>'
    scene = import_scene(write_world(tmp_path / "a.xml", room, turned), tmp_path / "a")
    assert tomllib.loads((scene.folder / "scene.toml").read_text())["up"] == "y"
    assert np.allclose(scene.bounds_m, [[-3.05, -3.05, 0.0], [3.05, 3.05, 2.5]], atol=1e-3)


def test_gravity_that_is_no_number_is_said(tmp_path):
    with pytest.raises(SceneError, match=r"gravity .*nan.* is no number"):
        import_scene(write_world(tmp_path / "a.xml", room_xml(), '<option gravity="nan 0 0"/>'), tmp_path / "a")


def test_what_does_not_collide_is_kept_whatever_the_file_says(tmp_path):
    ghost = '<geom type="box" size="0.2 0.3 0.4" pos="1 2 0.4" contype="0" conaffinity="0"/>'
    sizes = [
        import_scene(write_world(tmp_path / f"{k}.xml", room_xml() + ghost, more), tmp_path / str(k)).num_triangles
        for k, more in enumerate(("", '<compiler discardvisual="true"/>'))
    ]
    assert sizes[0] == sizes[1]


def test_worlds_with_more_contacts_than_memory_and_places_that_are_no_numbers(tmp_path):
    boxes = "".join(
        f'<body pos="{1 + 0.05 * (i % 20)} {1 + 0.05 * (i // 20)} 0.1"><geom type="box" size="0.02 0.02 0.1"/></body>'
        for i in range(200)
    )
    small = '<size memory="30K"/>'
    src = write_world(tmp_path / "many.xml", room_xml() + boxes, small)
    model = mujoco.MjModel.from_xml_path(str(src))
    with pytest.raises(mujoco.FatalError):
        mujoco.mj_forward(model, mujoco.MjData(model))
    assert len(import_scene(src, tmp_path / "many").triangles()[1]) > 200 * 12
    src = write_world(tmp_path / "nan.xml", room_xml() + '<geom name="lost" size="0.1" pos="nan 0 0"/>')
    with pytest.raises(SceneError, match="place of the geom lost is no number"):
        import_scene(src, tmp_path / "nan")
    for size in ("inf", "1e30"):
        src = write_world(tmp_path / "wide.xml", room_xml() + f'<geom name="wide" type="box" size="1 {size} 1"/>')
        with pytest.raises(SceneError, match="geom 'wide' is infinite, or reaches farther"):
            import_scene(src, tmp_path / "wide")
    src = write_world(tmp_path / "falls.xml", room_xml() + boxes.replace("<geom", "<freejoint/><geom", 1), small)
    with pytest.raises(SceneError, match=r"cannot simulate the world.*--settle"):
        import_scene(src, tmp_path / "falls", settle=True)


def test_what_a_few_words_blow_up_is_counted_before_it_is_made(tmp_path):
    ball = '<geom size="0.1"/>'
    fine = '<visual><quality numslices="{0}" numstacks="{0}"/></visual>'
    for name, body, quality in (("fine", ball, 100_000_000), ("many", ball * 200, 1000)):
        src = write_world(tmp_path / f"{name}.xml", room_xml() + body, fine.format(quality))
        with pytest.raises(SceneError, match=r"triangles.*ANM_MJ_MAX_TRIANGLES"):
            import_scene(src, tmp_path / name)


@pytest.mark.parametrize("timestep", ["1e-9", "10", "nan"])
def test_a_world_that_would_settle_for_hours_is_refused(tmp_path, timestep):
    ball = '<body pos="0 0 1"><freejoint/><geom size="0.1"/></body>'
    src = write_world(tmp_path / "world.xml", room_xml() + ball, f'<option timestep="{timestep}"/>')
    with pytest.raises(SceneError, match=r"timestep of .*without --settle"):
        import_scene(src, tmp_path / "out", settle=True)


def test_bodies_that_touch_are_settled_within_a_budget(tmp_path, monkeypatch):
    monkeypatch.setattr("anm_mj.scene.importing.readers.mjcf.compile_world.MAX_SETTLE_WORK", 1_000_000)
    one = '<body pos="0 0 {0}"><freejoint/><geom type="box" size="0.05 0.05 0.05"/></body>'
    pile = "".join(one.format(0.05 + 0.09 * level) for level in range(60))
    src = write_world(tmp_path / "world.xml", room_xml() + pile)
    with pytest.raises(SceneError, match=r"360 degrees of freedom and \d+ contacts.*ANM_MJ_MAX_SETTLE_WORK"):
        import_scene(src, tmp_path / "out", settle=True)
    src = write_world(tmp_path / "world.xml", room_xml() + one.format(0.05))
    assert len(import_scene(src, tmp_path / "out", settle=True).triangles()[1])
