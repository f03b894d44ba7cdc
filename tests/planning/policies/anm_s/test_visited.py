import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import minimum_filter

from anm_mj.planning.policies.anm_s.visited import nearest_view_m, num_within
from anm_mj.types import Footprint, OccupancyGrid


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.integers(0, 30), st.integers(0, 30))
def test_as_many_places_are_near_a_point_as_lie_nearer_than_the_radius(seed, num_points, num_places):
    rng = np.random.default_rng(seed)
    # On a grid, so that some lie at exactly the radius.
    points, places = (rng.integers(0, 8, (num, 2)).astype(float) for num in (num_points, num_places))
    distance = np.linalg.norm(points[:, None] - places[None], axis=-1)
    assert num_within(points, list(places), 2.0).tolist() == (distance < 2.0).sum(axis=1).tolist()


def test_the_nearest_view_of_a_border_point_is_that_of_the_cells_about_it():
    rng = np.random.default_rng(0)
    seen_m = np.where(rng.random((8, 14, 11)) < 0.2, rng.uniform(0.5, 6.0, (8, 14, 11)), np.inf).astype(np.float32)
    grid = OccupancyGrid(np.zeros(seen_m.shape, np.int8), seen_m, np.array([-0.3, 0.2, 0.0]), 0.1)
    footprint = Footprint(0.2, 0.1, 0.6)
    xy_m = np.concatenate([rng.uniform(-0.6, 1.8, (60, 2)), grid.origin_m[:2] + rng.integers(0, 11, (20, 2)) * 0.1])
    depth = minimum_filter(seen_m[1:6].min(axis=0), size=3)
    cell = np.clip(np.floor((xy_m - grid.origin_m[:2]) / 0.1).astype(int)[:, ::-1], 0, [13, 10])
    assert np.array_equal(nearest_view_m(grid, footprint, xy_m), depth[cell[:, 0], cell[:, 1]])
