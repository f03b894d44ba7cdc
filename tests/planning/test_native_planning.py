"""What the native engine computes for the planner, against the NumPy and SciPy code that is its reference."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anm_mj import _native
from anm_mj.geometry.connected_components import connected_components
from anm_mj.planning.distance_transform import capped_distance_cells
from anm_mj.planning.policies.gvg.ray_cache import Rays
from anm_mj.types import FREE, OCCUPIED, UNKNOWN
from tests.planning import numpy_planning as reference
from tests.planning.numpy_planning import KNOWN

SEEDS = st.integers(0, 1 << 30)


def drawn(rng, states, shape, share):
    """A grid with patches, as maps have: the first state but for boxes of the others."""
    grid = np.full(shape, states[0], np.int8)
    for _ in range(int(share * 20)):
        low = [rng.integers(0, n) for n in shape]
        grid[tuple(slice(a, a + rng.integers(1, 8)) for a in low)] = rng.choice(states)
    grid[rng.random(shape) < 0.02] = rng.choice(states)
    return grid


@settings(max_examples=40, deadline=None)
@given(SEEDS, st.floats(0.0, 1.0))
def test_cells_are_pooled_the_same(seed, share):
    rng = np.random.default_rng(seed)
    state = drawn(rng, (UNKNOWN, FREE, OCCUPIED), (int(rng.integers(4, 14)), 30, 21), share)
    shape = np.array([rng.integers(1, 8), rng.integers(2, 19), rng.integers(2, 15)])
    to = np.array([rng.integers(0, 3), rng.integers(0, 4), rng.integers(0, 4)])
    low, floor = np.array([rng.integers(-1, 4), *rng.integers(-3, 9, 2)]), int(rng.integers(-1, 6))
    before = drawn(rng, (UNKNOWN, FREE, OCCUPIED, KNOWN), (11, 23, 19), share)
    counted = [np.array([(layer == value).sum() for layer in before]) for value in (FREE, OCCUPIED)]
    found = [(before.copy(), *(count.copy() for count in counted)) for _ in range(2)]
    changed = [
        pool(state, low, shape, floor, cells, to, *counts)
        for pool, (cells, *counts) in zip((_native.pool_window, reference.numpy_pool), found, strict=True)
    ]
    assert changed[0] == changed[1]
    assert all(np.array_equal(a, b) for a, b in zip(*found, strict=True))
    cells, num_free, num_surface = found[0]
    assert np.array_equal(num_free, (cells == FREE).sum(axis=(1, 2)))
    assert np.array_equal(num_surface, (cells == OCCUPIED).sum(axis=(1, 2)))


def test_a_part_that_does_not_fit_is_refused():
    state, cells, count = np.zeros((4, 8, 8), np.int8), np.zeros((4, 4, 4), np.int8), np.zeros(4, np.int64)
    low, shape, to = np.zeros(3, int), np.array([2, 4, 4]), np.array([0, 3, 0])
    with pytest.raises(ValueError, match="outside the cells"):
        _native.pool_window(state, low, shape, 0, cells, to, count, count.copy())


def drawn_rays(rng, cells, num_rows=9, num_rays=12, num_samples=7):
    """Rays that stay within the cells, as if none was cast yet."""
    offset = np.cumsum(rng.integers(-3, 20, (num_rays, num_samples)), axis=1)
    start = rng.integers(70, cells.size - 200, num_rows)
    types = np.int32, np.int8, np.uint8, np.uint8
    return offset, start, Rays(*(np.full((num_rows, num_rays), -3 if t is np.int8 else 0, t) for t in types))


@settings(max_examples=40, deadline=None)
@given(SEEDS, st.floats(0.0, 1.0))
def test_rays_end_in_the_same_cells_with_the_same_gains(seed, share):
    rng = np.random.default_rng(seed)
    cells = drawn(rng, (FREE, UNKNOWN, OCCUPIED, KNOWN), (4, 12, 15), share)
    offset, start, blank = drawn_rays(rng, cells)
    found, expected = (Rays(*(array.copy() for array in blank)) for _ in range(2))
    for _ in range(3):
        rows = rng.integers(0, len(start), 6).astype(np.int32)
        _native.cast_rays(cells, offset, start, rows, *found)
        reference.numpy_cast_rays(cells, offset, start, rows, expected)
        for name in Rays._fields:
            assert np.array_equal(getattr(found, name), getattr(expected, name)), name
        cells[rng.random(cells.shape) < 0.1] = rng.choice((FREE, UNKNOWN, OCCUPIED))
    distance_m = np.linspace(0.25, 3.0, offset.shape[1], dtype=np.float32)
    tried_m = np.where(rng.random(cells.shape) < 0.3, rng.uniform(0.1, 4.0, cells.shape), np.inf).astype(np.float32)
    shares = rng.random(len(cells)).astype(np.float32)
    rule, gains = np.array([0.1, 0.3, 2.5, 0.7, 0.03], np.float32), np.empty(expected.hit.shape, np.float32)
    _native.ray_gains(*expected, distance_m, shares, tried_m, rule, gains)
    assert gains.tobytes() == reference.numpy_ray_gains(expected, distance_m, shares, tried_m, rule).tobytes()


def test_rays_that_leave_the_cells_are_refused():
    cells = np.zeros((2, 3, 4), np.int8)
    offset, start = np.full((1, 2), 25), np.zeros(1, np.int64)
    rays = Rays(*(np.full((1, 1), 1, t) for t in (np.int32, np.int8, np.uint8, np.uint8)))
    with pytest.raises(ValueError, match="leaves the cells"):
        _native.cast_rays(cells, offset, start, np.zeros(1, np.int32), *rays)
    gone, two = rays._replace(hit=np.full((1, 1), 24, np.int32)), np.ones(2, np.float32)
    tried_m, rule, gain = np.ones((2, 3, 4), np.float32), np.ones(5, np.float32), np.ones((1, 1), np.float32)
    with pytest.raises(ValueError, match="leaves the cells"):
        _native.ray_gains(*gone, two, two, tried_m, rule, gain)


@settings(max_examples=40, deadline=None)
@given(SEEDS, st.floats(0.0, 1.0))
def test_rays_without_a_measurement_end_the_same(seed, share):
    rng = np.random.default_rng(seed)
    cells = drawn(rng, (FREE, UNKNOWN, OCCUPIED, KNOWN), (9, 80, 81), share)
    angle = rng.uniform(0.0, 2.0 * np.pi, 20)
    direction = np.stack([np.cos(angle), np.sin(angle), rng.uniform(-2.0, 2.0, 20)], axis=1)
    frame = np.array([-4.05, -3.9, -0.2, 0.1, -0.15, 0.65])
    rays = cells, frame, rng.uniform(-0.5, 0.5, 3), direction, np.arange(0.25, 3.3, 0.1)
    found = tuple(np.empty(20, np.int64) for _ in range(2))
    _native.first_closed(*rays, *found)
    expected = reference.numpy_first_closed(*rays)
    assert all(np.array_equal(a, b) for a, b in zip(found, expected, strict=True))


@settings(max_examples=40, deadline=None)
@given(SEEDS, st.integers(0, 60), st.integers(1, 90), st.integers(0, 40), st.floats(0.3, 1.0))
def test_distances_are_the_same_bits(seed, rows, cols, cap, share):
    free = np.random.default_rng(seed).random((rows, cols)) < share**0.1
    assert capped_distance_cells(free, cap).tobytes() == reference.numpy_capped_distance_cells(free, cap).tobytes()


@settings(max_examples=40, deadline=None)
@given(SEEDS, st.integers(0, 40), st.integers(1, 50), st.floats(0.1, 0.9), st.sampled_from([0.0, 3.0, 12.5, 400.0]))
def test_holes_are_the_same(seed, rows, cols, share, max_cells):
    unknown = np.random.default_rng(seed).random((rows, cols)) < share
    holes = np.zeros(unknown.shape, bool)
    _native.small_components(unknown.view(np.uint8), max_cells, holes.view(np.uint8))
    assert np.array_equal(holes, reference.scipy_enclosed_holes(unknown, max_cells))


@settings(max_examples=40, deadline=None)
@given(SEEDS, st.integers(1, 60), st.integers(0, 90))
def test_components_have_the_same_numbers(seed, num, num_links):
    links = np.random.default_rng(seed).integers(0, num, (num_links, 2))
    assert np.array_equal(connected_components(links, num), reference.scipy_connected_components(links, num))


def test_links_to_nodes_that_are_not_there_are_refused():
    with pytest.raises(ValueError, match="no such node"):
        connected_components(np.array([[0, 3]]), 3)
