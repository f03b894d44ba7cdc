import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from anm_mj.planning.grid_windows import bounds, clipped, grown, hull, next_to, relative_to

SHAPE = (20, 30)


@pytest.mark.parametrize(
    ("first", "last", "window"),
    [
        ((3, 4), (7, 9), (slice(3, 7), slice(4, 9))),
        ((-5, 4), (7, 99), (slice(0, 7), slice(4, 30))),
        ((25, -9), (28, -2), (slice(20, 20), slice(0, 0))),
    ],
)
def test_a_part_ends_where_the_map_does(first, last, window):
    assert clipped(np.array(first), np.array(last), SHAPE) == window


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**31))
def test_bounds_hold_all_of_a_mask_and_no_row_or_column_more(seed):
    rng = np.random.default_rng(seed)
    window = slice(4, 15), slice(7, 28)
    mask = np.zeros(SHAPE, bool)
    mask[rng.integers(4, 15, 3), rng.integers(7, 28, 3)] = True
    (found,) = bounds(mask[window], window)
    assert mask[found].sum() == mask.sum()
    for edge in (mask[found][0], mask[found][-1], mask[found][:, 0], mask[found][:, -1]):
        assert edge.any()


def test_an_empty_mask_has_no_bounds():
    assert bounds(np.zeros((3, 4), bool), (slice(0, 3), slice(2, 6))) == []


def test_the_hull_holds_all_windows():
    assert hull([(slice(3, 5), slice(9, 12)), (slice(4, 8), slice(2, 3))]) == (slice(3, 8), slice(2, 12))


def test_a_window_grows_as_far_as_there_are_cells():
    assert grown((slice(5, 8), slice(9, 12)), 3, SHAPE) == (slice(2, 11), slice(6, 15))
    assert grown((slice(1, 18), slice(9, 29)), 3, SHAPE) == (slice(0, 20), slice(6, 30))


def test_a_window_relative_to_another_one_shows_the_same_cells():
    cells = np.arange(600).reshape(SHAPE)
    inner, outer = (slice(5, 8), slice(9, 12)), (slice(2, 11), slice(6, 15))
    assert np.array_equal(cells[outer][relative_to(inner, outer)], cells[inner])


@pytest.mark.parametrize("shape", [(9,), (9, 13), (5, 9, 13), (1, 1)])
def test_cells_next_to_a_mask_are_its_dilation_by_faces(shape):
    mask = np.random.default_rng(0).random(shape) < 0.1
    mask.flat[-1] = True
    before = mask.copy()
    assert np.array_equal(next_to(mask), ndimage.binary_dilation(mask))
    assert np.array_equal(mask, before)
