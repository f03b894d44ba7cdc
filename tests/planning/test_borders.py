import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from anm_mj.planning.borders import BorderPoints
from anm_mj.types import FREE, OCCUPIED, UNKNOWN


def random_part(rng, shape):
    state = rng.choice(np.array([FREE, OCCUPIED, UNKNOWN], np.int8), shape, p=[0.6, 0.2, 0.2])
    return state, np.where(state == FREE, rng.random(shape), -rng.random(shape)).astype(np.float32)


def points_of(state, field_m):
    borders = BorderPoints()
    borders.update(state, field_m, slice(0, len(state)))
    return borders


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31))
def test_points_kept_up_are_those_of_a_map_read_again(seed):
    rng = np.random.default_rng(seed)
    state, field_m = random_part(rng, (17, 13))
    kept = points_of(state, field_m)
    for _ in range(5):
        low, high = np.sort(rng.integers(0, [[17, 13], [17, 13]], (2, 2)), axis=0)
        part = slice(low[0], high[0] + 1), slice(low[1], high[1] + 1)
        state[part], field_m[part] = random_part(rng, state[part].shape)
        kept.update(state, field_m, part[0])
        again = points_of(state, field_m)
        assert np.array_equal(kept.surface_cells, again.surface_cells)
        assert np.array_equal(kept.frontier_cells, again.frontier_cells)


def test_a_map_that_has_grown_is_read_again():
    state, field_m = random_part(np.random.default_rng(0), (6, 5))
    kept = points_of(state, field_m)
    grown = np.pad(state, ((3, 2), (4, 1)), constant_values=UNKNOWN)
    deep = np.pad(field_m, ((3, 2), (4, 1)), constant_values=0.1)
    kept.update(grown, deep, slice(0, 0))
    assert np.array_equal(kept.surface_cells, points_of(grown, deep).surface_cells)
    assert len(kept.surface_cells) == len(points_of(state, field_m).surface_cells)


def test_points_lie_between_the_centres_of_neighbours():
    state = np.array([[FREE, OCCUPIED, UNKNOWN], [FREE, FREE, FREE]], np.int8)
    field_m = np.array([[0.1, -0.3, 0.1], [0.1, 0.1, 0.1]], np.float32)
    points = points_of(state, field_m)
    # To the right, then upwards; a quarter of the way from 0.1 to -0.3 the field is 0.
    assert np.allclose(points.surface_cells, [[0.75, 0.5], [1.5, 1.25]])
    assert np.allclose(points.frontier_cells, [[2.5, 1.0]])
