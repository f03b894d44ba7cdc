import logging
import tomllib

import mujoco
import numpy as np
import pytest

from anm_mj.errors import SceneError
from anm_mj.scene.build import build_model
from anm_mj.scene.collision import SLICE_Z_MAX_M
from anm_mj.scene.folder import load_scene
from anm_mj.scene.importing.import_scene import import_scene
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.mjcf.read_world import read_mjcf
from anm_mj.scene.importing.readers.source_formats import find_format
from anm_mj.scene.importing.storeys import find_storeys
from anm_mj.scene.navigable import DEFAULT_FOOTPRINT, is_clear
from anm_mj.types import Pose2
from tests.scene.importing.readers.mjcf.compare import agreement, eyes_in
from tests.scene.importing.readers.mjcf.house import write_house
from tests.scene.view import look

EYES = [(0.0, 0.0, 1.25, k * np.pi / 4) for k in range(8)] + [(-3, -1, 1, 0), (3, 1, 1.8, 3), (2, -3, 0.6, 0)]


@pytest.fixture(scope="module")
def house(tmp_path_factory):
    folder = tmp_path_factory.mktemp("house")
    src = write_house(folder / "src")
    return src, import_scene(src, folder / "house")


def write_world(path, body: str, more: str = ""):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"<mujoco>{more}<worldbody>{body}</worldbody></mujoco>")
    return path


def room_xml(half: float = 3.0, height: float = 2.5) -> str:
    floor = f'<geom name="floor" type="plane" size="{half} {half} 1"/>'
    walls = ((half, 0, 0.05, half), (-half, 0, 0.05, half), (0, half, half, 0.05), (0, -half, half, 0.05))
    return floor + "".join(
        f'<geom name="wall_{i}" type="box" pos="{x} {y} {height / 2}" size="{a} {b} {height / 2}"/>'
        for i, (x, y, a, b) in enumerate(walls)
    )


ROOM_WALLS = room_xml().partition("/>")[2]


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
    high = [own.geometry().vertices[:, 2][_near(own.geometry().vertices, (-1.0, 2.5), 0.25)] for own in (scene, fallen)]
    assert high[0][high[0] > 0.01].min() == pytest.approx(1.3, abs=0.01)
    assert high[1][high[1] > 0.01].max() == pytest.approx(0.4, abs=0.03)
    # The key frame has the chair a metre from where the file has it.
    assert _near(scene.geometry().vertices, (2.0, -2.0), 0.5).any()
    assert not (_near(scene.geometry().vertices, (1.0, -2.0), 0.3) & (scene.geometry().vertices[:, 2] > 0.1)).any()


def _near(vertices, xy, radius):
    inside = np.abs(vertices[:, :2] - np.array(xy)).max(axis=1) < radius
    # The ceiling and the ground span everything, but have no corners inside.
    return inside & (vertices[:, 2] < 2.4)


def test_endless_and_wide_grounds_are_cut_to_the_building(tmp_path):
    endless = room_xml().replace('size="3.0 3.0 1"', 'size="0 0 1"')
    scene = import_scene(write_world(tmp_path / "a.xml", endless), tmp_path / "a")
    assert np.allclose(scene.bounds_m[:, :2], [[-3.05, -3.05], [3.05, 3.05]], atol=1e-4)
    wide = room_xml().replace('size="3.0 3.0 1"', 'size="80 80 1"')
    scene = import_scene(write_world(tmp_path / "b.xml", wide), tmp_path / "b")
    assert np.allclose(scene.bounds_m[:, :2], [[-3.05, -3.05], [3.05, 3.05]], atol=1e-4)
    # A floor that is a bit longer than what stands on it stays whole.
    corridor = '<geom type="plane" size="12 2 1"/><geom type="box" size="5 0.1 1" pos="0 0 1"/>'
    scene = import_scene(write_world(tmp_path / "d.xml", corridor), tmp_path / "d")
    assert np.allclose(scene.bounds_m[:, :2], [[-12, -2], [12, 2]], atol=1e-4)
    # Without walls there is ground around things.
    thing = '<geom type="plane" size="0 0 1"/><geom type="box" size="0.2 0.2 0.5" pos="1 0 0.5"/>'
    scene = import_scene(write_world(tmp_path / "c.xml", thing), tmp_path / "c")
    assert np.allclose(scene.bounds_m[:, :2], [[-3, -4], [5, 4]], atol=1e-4)


@pytest.mark.parametrize(
    ("half", "at", "more"),
    [
        # A plane that ends, with more room outside of the house than inside.
        (5.0, "0 0 0", ""),
        # Walls that stand within the corners of others, and a front door.
        (0.0, "0 0 0", '<geom type="box" pos="2.6 -3.5 1.2" size="0.05 0.6 1.2"/>'),
        # A storey of its own height, far away, and one on a plinth above the ground.
        (0.0, "2000 -3000 12", ""),
        (0.0, "0 0 0.8", '<geom type="box" size="2.9 2.9 0.1" pos="0 0 -0.1"/>'),
    ],
)
def test_the_robot_starts_in_the_house_and_not_on_the_ground_around_it(tmp_path, half, at, more):
    house = f'<frame pos="{at}">{ROOM_WALLS}{more}</frame>'
    height = 12.0 if at.endswith("12") else 0.0
    ground = f'<geom type="plane" size="{half} {half} 1" pos="0 0 {height}"/>'
    scene = import_scene(write_world(tmp_path / "src" / "world.xml", ground + house), tmp_path / "out")
    start = scene.starts[0]
    assert max(abs(start.x_m), abs(start.y_m)) < 2.9


def test_planes_that_stand_upright_are_walls(tmp_path):
    sides = (("3 0 1.25", "-1 0 0"), ("-3 0 1.25", "1 0 0"), ("0 3 1.25", "0 -1 0"), ("0 -3 1.25", "0 1 0"))
    walls = "".join(f'<geom type="plane" size="3 3 1" pos="{at}" zaxis="{normal}"/>' for at, normal in sides)
    src = write_world(tmp_path / "src" / "world.xml", '<geom type="plane" size="0 0 1"/>' + walls)
    scene = import_scene(src, tmp_path / "out")
    assert np.allclose(np.ptp(scene.bounds_m, axis=0)[:2], 6.0, atol=0.02)
    assert max(abs(scene.starts[0].x_m), abs(scene.starts[0].y_m)) < 2.9


def test_the_ground_is_level_whatever_axis_points_up(tmp_path):
    body = f'<frame euler="-90 0 0"><geom type="plane" size="0 0 1"/>{ROOM_WALLS}</frame>'
    src = write_world(tmp_path / "src" / "world.xml", body, '<option gravity="0 -9.81 0"/>')
    size = np.ptp(import_scene(src, tmp_path / "out").bounds_m, axis=0)
    assert np.allclose(size, (6.1, 6.1, 2.5), atol=0.02)


def test_a_terrain_without_walls_has_no_storeys(tmp_path):
    rows, cols = np.indices((30, 30))
    terraces = (np.hypot(rows - 15, cols - 15) // 5).astype(int).ravel()
    heights = " ".join(map(str, terraces))
    more = f'<asset><hfield name="t" nrow="30" ncol="30" size="9 9 6 1" elevation="{heights}"/></asset>'
    src = write_world(tmp_path / "src" / "world.xml", '<geom type="hfield" hfield="t"/>', more)
    scene = import_scene(src, tmp_path / "out")
    assert scene.num_triangles > 1000
    level = np.array([[[0, 0, 0], [20, 0, 0], [20, 20, 0]], [[0, 0, 0], [20, 20, 0], [0, 20, 0]]], dtype=float)
    assert find_storeys(level) == []
    # The level underside, a metre below, is no floor.
    assert tomllib.loads((scene.folder / "scene.toml").read_text())["floor_removed"] > -0.05


def test_a_wide_box_is_a_ground_and_keeps_its_texture_where_it_is_cut(tmp_path):
    slab = '<geom type="box" size="900 600 0.5" pos="40 -30 -0.5" euler="0 0 20" material="board"/>'
    board = (
        '<asset><texture name="board" type="2d" builtin="checker" rgb1="1 0 0" rgb2="0 0 1" width="64" height="64"/>'
        '<material name="board" texture="board" texrepeat="600 400"/></asset>'
    )
    walls = room_xml().partition("/>")[2]
    src = write_world(tmp_path / "a.xml", slab + walls, board)
    scene = import_scene(src, tmp_path / "a")
    assert np.ptp(scene.bounds_m[:, 0]) < 12.0
    assert agreement(src, scene, EYES[:4]) > 0.9999
    ground = next(own for own in read_mjcf(src, [], ImportReport()).submeshes if own.texture is not None)
    assert ground.uv is not None
    # A square of the texture is 1.5 m long both ways, on whatever part of the ground.
    top = ground.faces[(ground.vertices_m[ground.faces][:, :, 2] > -0.01).all(axis=1)]
    for corners, uv in zip(ground.vertices_m[top], ground.uv[top], strict=True):
        metres = np.linalg.norm(np.roll(corners, 1, axis=0) - corners, axis=1)
        squares = np.linalg.norm((np.roll(uv, 1, axis=0) - uv) * (3.0, 3.0), axis=1)
        np.testing.assert_allclose(squares, metres, rtol=1e-3)
    # A floor that is as large as the hall on it stays whole.
    hall = '<geom type="box" size="11 11 0.1" pos="0 0 -0.1"/><geom type="box" size="5 5 1" pos="0 0 1"/>'
    scene = import_scene(write_world(tmp_path / "b.xml", hall), tmp_path / "b")
    assert np.allclose(scene.bounds_m[:, :2], [[-11, -11], [11, 11]], atol=1e-4)


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
    assert len(import_scene(src, tmp_path / "many").geometry().faces) > 200 * 12
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
    assert len(import_scene(src, tmp_path / "out", settle=True).geometry().faces)


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
