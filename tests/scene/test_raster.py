import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from anm_mj.scene.raster import Grid, clip_to_slab, distance_cells, grid_over, level_mask, rasterise

_GRID = Grid(np.array([-1.0, -1.0]), 0.1, 20, 20)


def _triangle(*corners):
    return np.array([corners], dtype=float)


def test_a_vertical_triangle_covers_the_cells_along_its_foot():
    wall = _triangle((-0.95, 0.05, 0.0), (0.95, 0.05, 0.0), (0.95, 0.05, 1.0))
    cells = rasterise(clip_to_slab(wall, 0.0, 1.0), _GRID)
    assert cells[10].all()
    assert cells.sum() == 20


def test_a_diagonal_wall_has_no_gap_to_slip_through():
    wall = _triangle((-0.93, -0.91, 0.0), (0.87, 0.95, 0.0), (0.87, 0.95, 2.0))
    cells = rasterise(clip_to_slab(wall, 0.1, 1.0), _GRID)
    rows, cols = np.nonzero(cells)
    steps = np.abs(np.diff(rows)) + np.abs(np.diff(cols))
    assert cells.any(axis=1)[1:19].all()
    # Side by side or one above the other, never only corner to corner.
    assert all(
        cells[r, c - 1 : c + 2].sum() + cells[r - 1 : r + 2, c].sum() > 2 for r, c in zip(rows, cols, strict=True)
    )
    assert steps.size


def test_only_the_part_within_the_slab_is_kept():
    # A ramp that rises from z = 0 at x = -1 to z = 2 at x = 1: between z = 0.5 and 1.5 it covers x = -0.5..0.5.
    ramp = np.array(
        [[(-1, -0.5, 0), (1, -0.5, 2), (1, 0.5, 2)], [(-1, -0.5, 0), (1, 0.5, 2), (-1, 0.5, 0)]], dtype=float
    )
    polygons = clip_to_slab(ramp, 0.5, 1.5)
    assert np.isclose(polygons[:, :, 0].min(), -0.5)
    assert np.isclose(polygons[:, :, 0].max(), 0.5)
    assert len(clip_to_slab(ramp, 3.0, 4.0)) == 0


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(*[st.floats(-0.9, 0.9)] * 2, st.floats(-1.0, 2.0)), min_size=3, max_size=3))
def test_every_point_of_a_triangle_within_the_slab_lies_in_a_set_cell(corners):
    triangle = np.array([corners], dtype=float)
    cells = rasterise(clip_to_slab(triangle, 0.0, 1.0), _GRID)
    weights = np.random.default_rng(0).dirichlet([0.5, 0.5, 0.5], size=400)
    points = weights @ triangle[0]
    # A hair inside the slab, where rounding cannot decide.
    points = points[(points[:, 2] > 1e-6) & (points[:, 2] < 1.0 - 1e-6)]
    col, row = np.floor((points[:, :2] - _GRID.origin_xy_m) / _GRID.resolution_m).astype(int).T
    near = cells.copy()
    near[1:] |= cells[:-1]
    near[:-1] |= cells[1:]
    near[:, 1:] |= near[:, :-1].copy()
    near[:, :-1] |= near[:, 1:].copy()
    inner = (points[:, :2] - _GRID.origin_xy_m) / _GRID.resolution_m % 1.0
    safe = ((inner > 1e-6) & (inner < 1 - 1e-6)).all(axis=1)
    assert cells[row[safe], col[safe]].all()
    assert near[row, col].all()


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(*[st.floats(-0.9, 0.9)] * 2), min_size=3, max_size=3))
def test_no_cell_is_set_that_a_triangle_does_not_touch(corners):
    triangle = np.array([[(x, y, 0.5) for x, y in corners]], dtype=float)
    cells = rasterise(clip_to_slab(triangle, 0.0, 1.0), _GRID)
    rows, cols = np.nonzero(cells)
    centres = _GRID.origin_xy_m + (np.stack([cols, rows], axis=1) + 0.5) * _GRID.resolution_m
    weights = np.random.default_rng(0).dirichlet([0.3, 0.3, 0.3], size=3000)
    points = (weights @ triangle[0])[:, :2]
    nearest = np.abs(centres[:, None] - points[None]).max(axis=2).min(axis=1)
    # Half a cell, and what the samples leave open.
    assert (nearest < 0.05 + 0.08).all()


def test_cell_centres_of_a_grid_lie_on_multiples_of_the_resolution():
    grid = grid_over(np.array([[0.013, -3.3, 0.0], [2.0, 1.0, 1.0]]), 0.025)
    centre = (grid.origin_xy_m + 0.5 * grid.resolution_m) / grid.resolution_m
    assert np.allclose(centre, np.round(centre))
    assert (grid.origin_xy_m <= [0.013, -3.3]).all()
    top = grid.origin_xy_m + grid.resolution_m * np.array([grid.cols, grid.rows])
    assert (top >= [2.0, 1.0]).all()


def test_level_triangles_are_found_whichever_way_they_face():
    up = _triangle((0, 0, 0), (1, 0, 0), (0, 1, 0))
    wall = _triangle((0, 0, 0), (1, 0, 0), (0, 0, 1))
    assert level_mask(np.concatenate([up, up[:, ::-1], wall])).tolist() == [True, True, False]


def test_without_an_obstacle_all_places_are_endlessly_far_from_one():
    assert np.isposinf(distance_cells(np.ones((4, 5), dtype=bool))).all()
