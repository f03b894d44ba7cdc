import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from anm_mj.utils.arrays import bounds, clamp, dilate, dilate_mask, relative_to, union

SHAPE = (20, 30)


@pytest.mark.parametrize(
    ("first", "last", "window"),
    [
        ((3, 4), (7, 9), (slice(3, 7), slice(4, 9))),
        ((-5, 4), (7, 99), (slice(0, 7), slice(4, 30))),
        ((25, -9), (28, -2), (slice(20, 20), slice(0, 0))),
    ],
)
def test_clamp(first, last, window):
    assert clamp(np.array(first), np.array(last), SHAPE) == window


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**31))
def test_bounds_are_tight(seed):
    rng = np.random.default_rng(seed)
    window = slice(4, 15), slice(7, 28)
    mask = np.zeros(SHAPE, bool)
    mask[rng.integers(4, 15, 3), rng.integers(7, 28, 3)] = True
    (found,) = bounds(mask[window], window)
    assert mask[found].sum() == mask.sum()
    for edge in (mask[found][0], mask[found][-1], mask[found][:, 0], mask[found][:, -1]):
        assert edge.any()


def test_empty_mask_has_no_bounds():
    assert bounds(np.zeros((3, 4), bool), (slice(0, 3), slice(2, 6))) == []


def test_union():
    assert union([(slice(3, 5), slice(9, 12)), (slice(4, 8), slice(2, 3))]) == (slice(3, 8), slice(2, 12))


def test_dilate_stays_inside_the_grid():
    assert dilate((slice(5, 8), slice(9, 12)), 3, SHAPE) == (slice(2, 11), slice(6, 15))
    assert dilate((slice(1, 18), slice(9, 29)), 3, SHAPE) == (slice(0, 20), slice(6, 30))


def test_relative_to():
    cells = np.arange(600).reshape(SHAPE)
    inner, outer = (slice(5, 8), slice(9, 12)), (slice(2, 11), slice(6, 15))
    assert np.array_equal(cells[outer][relative_to(inner, outer)], cells[inner])


@pytest.mark.parametrize("shape", [(9,), (9, 13), (5, 9, 13), (1, 1)])
def test_dilate_mask_is_scipys_dilation(shape):
    mask = np.random.default_rng(0).random(shape) < 0.1
    mask.flat[-1] = True
    before = mask.copy()
    assert np.array_equal(dilate_mask(mask), ndimage.binary_dilation(mask))
    assert np.array_equal(mask, before)
