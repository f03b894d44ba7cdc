import tomllib

import numpy as np
import pytest

from anm_mj.scene.importing.import_scene import import_scene
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.mjcf.read_world import read_mjcf
from anm_mj.scene.importing.storeys import find_storeys
from tests.scene.importing.readers.mjcf.compare import agreement
from tests.scene.importing.readers.mjcf.worlds import EYES, ROOM_WALLS, room_xml, write_world


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
