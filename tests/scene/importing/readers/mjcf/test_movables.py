"""The robot pushes what the import kept movable, and stops at what is too heavy."""

import mujoco
import pytest

from anm_mj.cli.main import main
from anm_mj.scene.build import build_model
from anm_mj.scene.importing.import_scene import import_scene
from anm_mj.sim.make_robot import make_robot
from anm_mj.types import Action, Pose2
from tests.scene.importing.readers.mjcf.worlds import ROOM_WALLS, room_xml, write_world


def test_a_scene_of_movable_objects_can_be_checked(tmp_path, capsys):
    crate = '<body name="crate" pos="1 0 0.3"><freejoint/><geom type="box" size="0.2 0.2 0.3" mass="2"/></body>'
    scene = import_scene(write_world(tmp_path / "a.xml", room_xml() + crate), tmp_path / "out", movable=True)
    assert main(["scene", "check", str(scene.folder), "--out", str(tmp_path / "sheet.png")]) == 0, capsys.readouterr()


def test_what_stands_on_furniture_stays_and_is_named(tmp_path, caplog):
    things = (
        '<body name="table" pos="1.2 0 0"><geom type="box" size="0.4 0.4 0.02" pos="0 0 0.7"/></body>'
        '<body name="cup" pos="1.2 0.1 0.76"><freejoint/><geom type="cylinder" size="0.04 0.04" mass="0.2"/></body>'
        '<body name="saucer" pos="1.2 0.1 0.81"><freejoint/><geom type="cylinder" size="0.06 0.01" mass="0.1"/></body>'
        '<body name="crate" pos="-1 0 0.3"><freejoint/><geom type="box" size="0.2 0.2 0.3" mass="2"/></body>'
    )
    scene = import_scene(write_world(tmp_path / "a.xml", room_xml() + things), tmp_path / "out", movable=True)
    assert "stand on or in what stays: cup, saucer" in caplog.text
    model = build_model(scene)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=500)
    assert model.njnt == 1
    assert data.body("movable_0").xpos == pytest.approx([-1.0, 0.0, 0.3], abs=0.02)


@pytest.mark.parametrize(("mass", "gives_way"), [(2.0, True), (2000.0, False)])
def test_the_physics_drive_pushes_what_gives_way(tmp_path, mass, gives_way):
    crate = (
        f'<body name="crate" pos="1 0 0.3"><freejoint/><geom type="box" size="0.2 0.2 0.3" mass="{mass}" '
        'friction="0.3 0.005 0.0001"/></body>'
    )
    scene = import_scene(write_world(tmp_path / "a.xml", room_xml() + crate), tmp_path / "out", movable=True)
    with make_robot(scene, start=Pose2(0.3, 0.0, 0.0), drive="physics", image_px=16) as robot:
        collided = [robot.act(Action.MOVE_FORWARD).collided for _ in range(10)]
        moved_m = robot.data.body("movable_0").xpos[0] - 1.0
    assert any(collided) != gives_way
    assert (moved_m > 0.2) == gives_way


_CART = (
    '<body name="cart" pos="1 0 0.3"><freejoint/>'
    '<body name="tray"><geom type="box" size="0.2 0.2 0.3" mass="2"/></body></body>'
)


def test_a_choice_of_parts_keeps_a_body_all_of_whose_geoms_are_on_bodies_below_it(tmp_path):
    lamp = '<body name="lamp" pos="-1 0 0.3"><geom type="box" size="0.1 0.1 0.3"/></body>'
    src = write_world(tmp_path / "a.xml", room_xml() + _CART + lamp)
    for choice, number in (
        ({"leave_out": ["lamp"]}, 1),
        ({"leave_out": ["cart"]}, 0),
        ({"only": ["tray", "floor", "wall_*"]}, 1),
    ):
        scene = import_scene(src, tmp_path / "out", movable=True, **choice)
        assert build_model(scene).njnt == number


def test_a_movable_body_that_lies_far_from_the_world_goes_with_its_geoms(tmp_path):
    src = write_world(tmp_path / "a.xml", room_xml() + _CART.replace("1 0 0.3", "200 0 0.3"))
    assert build_model(import_scene(src, tmp_path / "out", movable=True)).njnt == 0


@pytest.mark.parametrize(("moments", "euler"), [("0.1 0.1 0.2", "0 40 50"), ("0.1 0.1 1e-12", "0 10 50")])
def test_a_disc_and_a_rod_of_the_flattest_and_thinnest_kind_can_be_pushed(tmp_path, moments, euler):
    thing = (
        '<body name="thing" pos="1 0 0.5" euler="10 20 30"><freejoint/><geom type="cylinder" size="0.2 0.02"/>'
        f'<inertial pos="0 0 0" euler="{euler}" mass="1" diaginertia="{moments}"/></body>'
    )
    model = build_model(import_scene(write_world(tmp_path / "a.xml", room_xml() + thing), tmp_path / "a", movable=True))
    assert sorted(model.body("movable_0").inertia) == pytest.approx(sorted(map(float, moments.split())), abs=1e-7)


def test_a_body_of_which_nothing_collides_stays_and_is_named(tmp_path, caplog):
    ghost = (
        '<body name="ghost" pos="1 0 0.5"><freejoint/>'
        '<geom type="box" size="0.2 0.2 0.3" mass="2" contype="0" conaffinity="0"/></body>'
    )
    scene = import_scene(write_world(tmp_path / "a.xml", room_xml() + ghost), tmp_path / "out", movable=True)
    assert build_model(scene).njnt == 0
    assert "nothing of them collides: the free bodies ghost" in caplog.text


@pytest.mark.parametrize(("storey", "number"), [("1", 0), ("2", 1)])
def test_an_object_is_on_the_storey_of_its_mass_wherever_its_origin_lies(tmp_path, storey, number):
    walls = ROOM_WALLS.replace(' 1.25" size', ' 3.9" size').replace("wall_", "upper_")
    slab = '<geom type="box" size="3 3 0.1" pos="0 0 2.6"/>'
    crate = '<body name="crate"><freejoint/><geom type="box" size="0.2 0.2 0.3" pos="1 0 3" mass="2"/></body>'
    src = write_world(tmp_path / "a.xml", room_xml() + slab + walls + crate)
    assert build_model(import_scene(src, tmp_path / "out", movable=True, storey=storey)).njnt == number
