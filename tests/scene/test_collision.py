import numpy as np
import trimesh

from anm_mj.scene.collision import collision_boxes, fill_pockets, merge_cells
from anm_mj.scene.raster import Grid
from tests.scene.shapes import box, room, table, two_rooms


def _covered(boxes, x, y):
    return bool(((boxes[:, 0] <= x) & (x <= boxes[:, 2]) & (boxes[:, 1] <= y) & (y <= boxes[:, 3])).any())


def _boxes(*meshes):
    mesh = trimesh.util.concatenate(meshes)
    return collision_boxes(mesh.vertices[mesh.faces])


def test_a_doorway_stays_open_at_its_full_width_but_for_a_cell():
    boxes = _boxes(two_rooms(door_width=0.9))
    for y in np.linspace(2.0 - 0.45 + 0.025, 2.0 + 0.45 - 0.025, 30):
        assert not _covered(boxes, 3.0, y)
    assert _covered(boxes, 3.0, 1.5)
    assert _covered(boxes, 3.0, 2.5)


def test_a_table_leg_of_four_centimetres_is_there():
    legs_only = _boxes(room(), *[box((x, 2.0, 0.0), (x + 0.04, 2.04, 0.72)) for x in (2.0, 3.0)])
    for x in (2.0, 3.0):
        assert _covered(legs_only, x + 0.02, 2.02)
        assert not _covered(legs_only, x + 0.1, 2.02)
        assert not _covered(legs_only, x + 0.02, 2.1)


def test_a_table_is_as_solid_as_its_outline():
    boxes = _boxes(room(), table(2.0, 1.5))
    assert _covered(boxes, 2.6, 1.9)
    assert not _covered(boxes, 1.9, 1.9)


def test_boxes_are_true_to_the_walls_within_a_cell():
    boxes = _boxes(room())
    for inside, outside in (((-0.05, 2.0), (0.02, 2.0)), ((6.05, 2.0), (5.98, 2.0)), ((3.0, 4.05), (3.0, 3.98))):
        assert _covered(boxes, *inside)
        assert not _covered(boxes, *outside)


def test_rugs_and_lamps_are_no_obstacles():
    boxes = _boxes(room(), box((2.0, 1.0, 0.0), (3.0, 2.0, 0.02)), box((4.0, 1.0, 1.8), (4.4, 1.4, 2.2)))
    assert not _covered(boxes, 2.5, 1.5)
    assert not _covered(boxes, 4.2, 1.2)


def test_a_hollow_wall_is_one_box():
    assert len(_boxes(box((0.0, 0.0, 0.0), (2.0, 0.1, 2.0)))) == 1


def test_nothing_at_body_height_gives_no_boxes():
    assert len(_boxes(box((0.0, 0.0, -0.1), (2.0, 2.0, 0.0)))) == 0


def test_merged_rectangles_cover_exactly_the_cells():
    cells = np.random.default_rng(3).random((40, 30)) < 0.4
    grid = Grid(np.array([1.0, -2.0]), 0.5, 40, 30)
    painted = np.zeros(cells.shape, dtype=int)
    for x0, y0, x1, y1 in merge_cells(cells, grid):
        r0, r1 = round((y0 + 2.0) / 0.5), round((y1 + 2.0) / 0.5)
        c0, c1 = round((x0 - 1.0) / 0.5), round((x1 - 1.0) / 0.5)
        painted[r0:r1, c0:c1] += 1
    assert np.array_equal(painted, cells.astype(int))


def test_rooms_are_no_pockets_but_cavities_are():
    occupied = np.zeros((60, 60), dtype=bool)
    occupied[5:55, [5, 54]] = occupied[[5, 54], 5:55] = True
    occupied[20, 20:24] = occupied[23, 20:24] = occupied[20:24, 20] = occupied[20:24, 23] = True
    filled = fill_pockets(occupied, radius_cells=4.0)
    assert filled[21:23, 21:23].all()
    assert not filled[30, 30]
    assert not filled[0, 0]
