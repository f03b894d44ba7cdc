import logging
import tomllib

import mujoco
import numpy as np
import pytest

from anm_mj.errors import SceneError
from anm_mj.scene.build import build_model
from anm_mj.scene.check import check_scene
from anm_mj.scene.collision import SLICE_Z_MAX_M
from anm_mj.scene.folder import load_scene
from anm_mj.scene.importing.import_scene import import_scene
from anm_mj.scene.importing.readers.source_formats import find_format
from anm_mj.scene.navigable import is_clear
from anm_mj.types import DEFAULT_FOOTPRINT, Pose2
from tests.scene.importing.readers.mjcf.compare import agreement, eyes_in
from tests.scene.importing.readers.mjcf.house import write_house
from tests.scene.importing.readers.mjcf.worlds import EYES, near, room_xml, write_world
from tests.scene.view import look


@pytest.fixture(scope="module")
def house(tmp_path_factory):
    folder = tmp_path_factory.mktemp("house")
    src = write_house(folder / "src")
    return src, import_scene(src, folder / "house")


def test_every_kind_of_geom_has_the_depth_that_mujoco_draws(house):
    src, scene = house
    assert find_format(src).name == "mjcf"
    assert agreement(src, scene, EYES, hidden=("rover",)) > 0.9999


def test_colours_and_textures_are_those_that_mujoco_draws_unlit(house):
    src, scene = house
    spec = mujoco.MjSpec.from_file(str(src))
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [1, 1, 1], [0, 0, 0]
    spec.visual.headlight.specular = [0, 0, 0]
    for light in list(spec.lights):
        spec.delete(light)
    # Glass is opaque in a scene.
    spec.geom("glass").rgba[3] = 1.0
    for eye, right in (((0.0, 1.0, 1.25), (1, 0, 0)), ((1.0, 1.5, 0.8), (0, -1, 0)), ((0.2, -2.5, 1.0), (0, 1, 0))):
        quat = np.zeros(4)
        up = np.array([0.0, 0.0, 1.0])
        mujoco.mju_mat2Quat(quat, np.stack([right, up, np.cross(right, up)], axis=1).ravel())
        own = spec.copy()
        own.worldbody.add_camera(name="eye", pos=eye, quat=quat, fovy=90.0)
        model = own.compile()
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        mujoco.mj_forward(model, data)
        model.geom_group[model.body_rootid[model.geom_bodyid] == model.body("rover").id] = 5
        with mujoco.Renderer(model, 65, 65) as renderer:
            for flag in ("SHADOW", "SKYBOX", "REFLECTION"):
                renderer.scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{flag}")] = 0
            renderer.update_scene(data, "eye")
            expected = renderer.render().astype(int)
        off = np.abs(look(scene, eye, right).astype(int) - expected).max(axis=2)
        assert np.median(off) <= 2
        # Edges of the chequers fall on other pixels where the textures have other mipmaps.
        assert (off > 40).mean() < 0.05


def test_what_is_left_out_is_said(house, tmp_path, caplog):
    with caplog.at_level(logging.INFO):
        import_scene(house[0], tmp_path / "out")
    assert "the robots rover." in caplog.text
    assert "2 actuators, 1 camera, 1 light, 1 marker (site)" in caplog.text
    assert "free bodies chair, box; --movable" in caplog.text


@pytest.mark.parametrize(
    ("size", "joint", "is_robot"),
    [
        ("0.45 0.02 1", 'type="slide" axis="1 0 0"', False),
        ("0.45 0.02 1", 'axis="0 0 1"', False),
        ("0.01 0.01 0.05", 'type="slide" axis="1 0 0"', True),
        ("0.05 0.02 0.05", 'axis="0 1 0"', True),
    ],
    ids=["sliding door", "swing door", "gripper", "wheels"],
)
@pytest.mark.parametrize(
    "on_it", ["", '<body><joint axis="0 1 0"/><geom type="box" size="0.05 0.02 0.01"/></body>'], ids=["", "handle"]
)
def test_both_leaves_of_a_driven_door_stay(tmp_path, caplog, size, joint, is_robot, on_it):
    parts = "".join(
        f'<body name="part_{i}" pos="{x} 0 0"><joint name="{i}" {joint}/><geom type="box" size="{size}"/>{on_it}</body>'
        for i, x in enumerate((-0.45, 0.45))
    )
    driven = '<actuator><motor joint="0"/><motor joint="1"/></actuator>'
    body = f'{room_xml()}<body name="frame" pos="0 0 1.01"><geom type="box" size="0.05 0.05 0.02"/>{parts}</body>'
    scene = import_scene(write_world(tmp_path / "a.xml", body, driven), tmp_path / "a")
    assert ("the robots frame." in caplog.text) == is_robot
    assert near(scene.triangles()[0], (0.0, 0.0), 0.95).any() != is_robot


def test_what_collides_is_what_the_robot_meets(house):
    _, scene = house
    # The crate is drawn only, its hull collides only.
    assert not is_clear(scene, Pose2(-3.5, 3.0, 0.0), DEFAULT_FOOTPRINT)
    _, faces = scene.obstacles()
    assert len(faces) != scene.num_triangles
    boxes = build_model(scene)
    data = mujoco.MjData(boxes)
    mujoco.mj_forward(boxes, data)
    down, geom = np.array([0.0, 0.0, -1.0]), np.zeros(1, dtype=np.int32)
    for x, y, solid in ((-3.5, 3.0, True), (2.0, -2.0, True), (0.0, 0.0, False), (0.3, 0.5, False)):
        above = np.array([x, y, SLICE_Z_MAX_M + 0.5])
        hit = mujoco.mj_ray(boxes, data, above, down, np.array([0, 0, 0, 1, 0, 0], np.uint8), 1, -1, geom)
        assert (hit < 1.0) == solid


def test_a_project_scene_exported_as_mjcf_keeps_its_depth_and_its_room(tmp_path):
    home = load_scene("flat")
    scene = import_scene(home.xml, tmp_path / "again")
    assert agreement(home.xml, scene, eyes_in(home, 2)) > 0.9999
    assert scene.rooms == home.rooms
    assert all(is_clear(scene, start, DEFAULT_FOOTPRINT) for start in scene.starts)


def test_bodies_stand_at_the_key_frame_or_drop_to_rest(house, tmp_path):
    src, scene = house
    fallen = import_scene(src, tmp_path / "fallen", settle=True)
    high = [own.triangles()[0][:, 2][near(own.triangles()[0], (-1.0, 2.5), 0.25)] for own in (scene, fallen)]
    assert high[0][high[0] > 0.01].min() == pytest.approx(1.3, abs=0.01)
    assert high[1][high[1] > 0.01].max() == pytest.approx(0.4, abs=0.03)
    # The key frame has the chair a metre from where the file has it.
    assert near(scene.triangles()[0], (2.0, -2.0), 0.5).any()
    assert not (near(scene.triangles()[0], (1.0, -2.0), 0.3) & (scene.triangles()[0][:, 2] > 0.1)).any()


def test_planes_that_stand_upright_are_walls(tmp_path):
    sides = (("3 0 1.25", "-1 0 0"), ("-3 0 1.25", "1 0 0"), ("0 3 1.25", "0 -1 0"), ("0 -3 1.25", "0 1 0"))
    walls = "".join(f'<geom type="plane" size="3 3 1" pos="{at}" zaxis="{normal}"/>' for at, normal in sides)
    src = write_world(tmp_path / "src" / "world.xml", '<geom type="plane" size="0 0 1"/>' + walls)
    scene = import_scene(src, tmp_path / "out")
    assert np.allclose(np.ptp(scene.bounds_m, axis=0)[:2], 6.0, atol=0.02)
    assert max(abs(scene.starts[0].x_m), abs(scene.starts[0].y_m)) < 2.9


def test_a_movable_object_keeps_its_mass_and_may_be_pushed(house, tmp_path):
    scene = import_scene(house[0], tmp_path / "out", movable=True)
    model = build_model(scene)
    source = mujoco.MjModel.from_xml_path(str(house[0]))
    entries = tomllib.loads((scene.folder / "scene.toml").read_text())
    assert entries["movables"] == ["chair", "box"]
    for i, name in enumerate(("chair", "box")):
        assert model.body(f"movable_{i}").mass[0] == pytest.approx(source.body(name).mass[0])
        inertia, own = model.body(f"movable_{i}").inertia, source.body(name).inertia
        assert np.sort(inertia) == pytest.approx(np.sort(own), rel=1e-4)
    # The chair stands where the key frame has it, the box falls, and both come to rest on the floor.
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=1500)
    assert data.body("movable_0").xpos == pytest.approx([2.0, -2.0, 0.0], abs=0.02)
    assert data.body("movable_1").xpos == pytest.approx([-1.0, 2.5, 0.2], abs=0.02)
    data.body("movable_0").xfrc_applied[:] = [60.0, 0, 0, 0, 0, 0]
    mujoco.mj_step(model, data, nstep=300)
    assert data.body("movable_0").xpos[0] > 2.2
    # Its pictures go with it, and at first it is where the unmovable scene has it.
    assert agreement(house[0], scene, EYES, hidden=("rover",)) > 0.9999


def test_groups_choose_what_is_seen(tmp_path):
    body = room_xml() + '<geom name="hull" type="box" size="0.5 0.5 0.5" pos="1 1 0.5" group="3"/>'
    src = write_world(tmp_path / "a.xml", body)
    plain = import_scene(src, tmp_path / "plain")
    shown = import_scene(src, tmp_path / "shown", groups=[0, 3])
    assert shown.num_triangles - plain.num_triangles == 12
    with pytest.raises(SceneError, match="holds nothing that is drawn"):
        import_scene(src, tmp_path / "none", groups=[5])


def test_a_world_in_which_nothing_collides_is_met_as_it_is_drawn(tmp_path, caplog):
    body = room_xml().replace("<geom ", '<geom contype="0" conaffinity="0" ')
    scene = import_scene(write_world(tmp_path / "a.xml", body), tmp_path / "a")
    assert "Nothing in the world collides" in caplog.text
    assert not is_clear(scene, Pose2(3.0, 0.0, 0.0), DEFAULT_FOOTPRINT)


def test_options_of_mujoco_worlds_are_refused_for_other_sources(tmp_path):
    src = tmp_path / "a.obj"
    src.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(SceneError, match="leave --settle, --movable and --groups out"):
        import_scene(src, tmp_path / "out", settle=True)


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 10))])
def test_mazes_of_dm_control_have_the_depth_that_mujoco_draws(tmp_path, seed):
    labmaze = pytest.importorskip("labmaze", reason="labmaze has no wheel for this Python")
    from dm_control.locomotion.arenas import labmaze_textures, mazes
    from dm_control.mjcf import export_with_assets

    maze = labmaze.RandomMaze(height=9, width=9, random_seed=seed, max_rooms=2, room_min_size=3, room_max_size=5)
    arena = mazes.MazeWithTargets(
        maze=maze,
        xy_scale=1.5,
        z_height=2.0,
        wall_textures=labmaze_textures.WallTextures(style="style_01"),
        floor_textures=labmaze_textures.FloorTextures(style="style_01"),
    )
    arena.regenerate()
    export_with_assets(arena.mjcf_model, str(tmp_path / "src"), "maze.xml")
    scene = import_scene(tmp_path / "src" / "maze.xml", tmp_path / "out")
    assert agreement(tmp_path / "src" / "maze.xml", scene, eyes_in(scene, 2, 1.0)) > 0.9999


def test_the_robot_stands_on_a_floor_that_the_camera_does_not_see(tmp_path):
    hidden = room_xml().replace('name="floor"', 'name="floor" group="3" pos="0 0 0.4"')
    scene = import_scene(write_world(tmp_path / "a.xml", hidden), tmp_path / "out")
    # The walls, which are all that is drawn, begin as far below the floor.
    assert scene.bounds_m[:, 2] == pytest.approx([-0.4, 2.1])
    assert is_clear(scene, scene.starts[0], DEFAULT_FOOTPRINT)
    assert scene.rooms == 1
    check = check_scene(scene, DEFAULT_FOOTPRINT)
    assert (check.floor_m, check.problems, check.holes) == (pytest.approx(0.0, abs=1e-6), (), ())


def test_what_catches_things_below_a_building_is_no_floor_of_it(tmp_path):
    caught = room_xml() + '<geom type="box" size="3 3 0.05" pos="0 0 -2.05" group="3"/>'
    scene = import_scene(write_world(tmp_path / "a.xml", caught), tmp_path / "out")
    assert tomllib.loads((scene.folder / "scene.toml").read_text())["floor_removed"] == 0.0
    assert scene.bounds_m[0, 2] == pytest.approx(0.0, abs=0.01)
