"""What the native engine computes beside training, against the NumPy code that is its reference."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anm_mj import _native
from anm_mj.mapping import lattice
from anm_mj.mapping.backends.native_backend import NativeBackend
from anm_mj.mapping.field_blocks import DoubtRule, decide_voxels, voxel_centres, voxels_to_read, write_blocks
from anm_mj.mapping.keyframes import PIXEL, ray_batches
from anm_mj.mapping.mapping_config import MappingConfig
from anm_mj.mapping.occupancy_kernels import BLOCK
from anm_mj.mapping.rays import CAMERA_NUMBERS, RayBatch
from anm_mj.types import FREE, OCCUPIED, UNKNOWN
from tests.mapping import numpy_reference


def stored(rng, count, num_cameras):
    pixels = np.empty(count, PIXEL)
    cameras = rng.normal(size=(num_cameras, CAMERA_NUMBERS)).astype(np.float32)
    cameras[:, 0] = rng.integers(1, 400, num_cameras)
    cameras[:, 1:3] = rng.uniform(20.0, 300.0, (num_cameras, 2))
    pixels["index"] = rng.integers(0, 100_000, count)
    pixels["rgb"] = rng.integers(0, 256, (count, 3))
    pixels["depth"] = rng.integers(0, 1 << 16, count) * rng.integers(0, 2, count)
    return pixels, cameras


def others(rng, count):
    origin, direction, rgb = rng.normal(size=(3, count, 3)).astype(np.float32)
    return RayBatch(origin, direction, rgb, np.where(rng.random(count) < 0.3, np.nan, 1.0).astype(np.float32))


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 1 << 30), st.integers(1, 4), st.integers(0, 40), st.integers(0, 5))
def test_rays_of_stored_pixels_are_the_same_bits(seed, num_batches, num_stored, num_current):
    rng = np.random.default_rng(seed)
    pixels, cameras = stored(rng, 50, 3)
    place = rng.integers(0, 50, (num_batches, num_stored))
    keyframe = rng.integers(0, 3, (num_batches, num_stored))
    current = others(rng, num_batches * num_current)
    expected = numpy_reference.ray_batches(pixels, cameras, place, keyframe, current)
    found = ray_batches(pixels, cameras, place, keyframe, current)
    for name in vars(expected):
        assert getattr(found, name).tobytes() == getattr(expected, name).tobytes(), name


def test_pixels_and_keyframes_that_are_not_stored_are_refused():
    rng = np.random.default_rng(0)
    pixels, cameras = stored(rng, 5, 1)
    zero = np.zeros((1, 1), np.int64)
    for place, keyframe in ((zero + 5, zero), (zero, zero + 1), (zero - 1, zero)):
        with pytest.raises(ValueError, match="not among those stored"):
            ray_batches(pixels, cameras, place, keyframe, others(rng, 0))


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 1 << 30), st.sampled_from([0.0, 0.002, 0.05, 0.6]), st.integers(0, 8))
def test_blocks_are_read_and_written_the_same(seed, share, count):
    rng = np.random.default_rng(seed)
    shape = tuple(BLOCK * rng.integers(1, 3, 3))
    state = np.where(rng.random(shape) < 0.5, FREE, UNKNOWN).astype(np.int8)
    state[rng.random(shape) < share] = OCCUPIED
    before = state.copy()
    before[rng.random(shape) < rng.choice([0.0, 1e-4])] = OCCUPIED
    every = np.argwhere(np.ones([n // BLOCK for n in shape], bool))
    blocks = every[np.sort(rng.permutation(len(every))[:count])]
    voxels = numpy_reference.voxels_to_read(state, blocks)
    assert np.array_equal(voxels_to_read(state, blocks), voxels)
    doubtful = numpy_reference.voxels_to_read(state, blocks, before)
    assert np.array_equal(doubtful, voxels[state.ravel()[voxels] != before.ravel()[voxels]])
    assert np.array_equal(voxels_to_read(state, blocks, before), doubtful)
    read = np.where(rng.random(len(voxels)) < 0.5, np.int8(FREE), np.int8(OCCUPIED))
    outs = before.copy(), before.copy()
    writers = write_blocks, numpy_reference.write_blocks
    moved = [write(state, blocks, voxels, read, out) for write, out in zip(writers, outs, strict=True)]
    assert np.array_equal(outs[0], outs[1])
    assert np.array_equal(moved[0], moved[1])


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 1 << 30), st.integers(0, 200))
def test_voxels_are_placed_and_decided_the_same(seed, count):
    rng = np.random.default_rng(seed)
    shape = tuple(BLOCK * int(n) for n in rng.integers(1, 3, 3))
    voxels, corner = rng.integers(0, np.prod(shape), count), rng.integers(-200, 200, 3)
    expected = numpy_reference.voxel_centres(voxels, shape, corner, 0.05)
    assert expected.shape == (count, 3)
    assert voxel_centres(voxels, shape, corner, 0.05).tobytes() == expected.tobytes()
    state = rng.integers(FREE, OCCUPIED + 1, shape).astype(np.int8)
    seen_m = rng.uniform(0.1, 4.0, shape).astype(np.float32)
    seen_m[rng.random(shape) < 0.1] = np.inf
    sdf_m = rng.uniform(-0.1, 0.1, count).astype(np.float32)
    sdf_m[rng.random(count) < 0.1] = 0.0
    rule = DoubtRule(0.0375, 0.025, float(rng.choice([0.01, 0.03, np.inf])), 0.043, float(rng.choice([0.05, 0.5])))
    decided = numpy_reference.decide_voxels(state, seen_m, voxels, sdf_m, rule)
    assert count < 100 or len(np.unique(decided)) == 2
    assert np.array_equal(decide_voxels(state, seen_m, voxels, sdf_m, rule), decided)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 1 << 30), st.sampled_from([0.0, 0.002, 0.1]), st.sampled_from([0.03, 0.05, 0.1, 0.2]))
def test_surface_is_looked_for_on_the_same_edges(seed, share, spacing_m):
    rng = np.random.default_rng(seed)
    shape = tuple(BLOCK * int(n) for n in rng.integers(1, 4, 3))
    state = np.where(rng.random(shape) < share, OCCUPIED, FREE).astype(np.int8)
    every = np.argwhere(np.ones([n // BLOCK for n in shape[::-1]], bool))
    corner = BLOCK * rng.integers(-5, 5, 3)
    blocks = every[rng.permutation(len(every))[: rng.integers(1, 6)]] + corner // BLOCK

    def wavy(points_m):
        return np.sin(7.0 * points_m @ np.array([1.0, 0.6, 0.3]) + 0.1).astype(np.float32)

    cells, first = lattice.touched_cells(state, corner, blocks, 0.05 / spacing_m)
    found = cells, first, lattice.crossings(wavy, cells, first, spacing_m)
    cells, first = numpy_reference.touched_cells(state, corner, blocks, 0.05 / spacing_m)
    expected = cells, first, numpy_reference.crossings(wavy, cells, first, spacing_m)
    for a, b in zip(found, expected, strict=True):
        assert a.dtype == b.dtype
        assert a.shape == b.shape
        assert a.tobytes() == b.tobytes()
    assert (expected[0].size > 0) == (state_of_blocks(state, blocks - corner // BLOCK) == OCCUPIED).any()


def state_of_blocks(state, blocks):
    return np.concatenate(
        [state[tuple(slice(BLOCK * k, BLOCK * (k + 1)) for k in block[::-1])].ravel() for block in blocks]
    )


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 1 << 30), st.integers(2, 25), st.integers(0, 400), st.sampled_from([0.0, 0.7, 1.0]))
def test_variance_over_passes_is_the_same_bits(seed, num_passes, num_points, color_weight):
    rng = np.random.default_rng(seed)
    s = rng.normal(size=(num_passes, num_points)).astype(np.float32)
    rgb = rng.random((num_passes, num_points, 3)).astype(np.float32)
    expected = numpy_reference.pass_variance(s, rgb, color_weight)
    found = _native.pass_variance(s, rgb, color_weight)
    # NumPy sums the passes of a lone point in another order.
    assert found.tobytes() == expected.tobytes() or (num_points == 1 and np.allclose(found, expected, rtol=1e-5))


def test_more_voxels_than_there_was_room_for_are_read():
    state = np.full((BLOCK, 4 * BLOCK, 4 * BLOCK), OCCUPIED, np.int8)
    blocks = np.argwhere(np.ones((1, 4, 4), bool))
    assert np.array_equal(voxels_to_read(state, blocks), numpy_reference.voxels_to_read(state, blocks))


def test_blocks_outside_the_grid_are_refused():
    state = np.zeros((BLOCK, BLOCK, BLOCK), np.int8)
    with pytest.raises(ValueError, match="outside the grid"):
        voxels_to_read(state, np.array([[0, 1, 0]]))


def test_lent_cores_leave_one_at_least():
    lend = _native.lend_cores
    points = np.random.default_rng(0).random((500, 3))
    try:
        lend(99)
        with_one = NativeBackend(MappingConfig(), seed=0, num_threads=2).query_sdf(points)
    finally:
        lend(0)
    assert np.array_equal(NativeBackend(MappingConfig(), seed=0, num_threads=2).query_sdf(points), with_one)


def test_a_thread_that_waits_for_a_longer_task_wakes_when_it_is_done():
    lower = _native.lower_distances
    rng = np.random.default_rng(0)
    points = rng.random((3000, 3))
    # Of the two tasks one has milliseconds to do and the other next to nothing.
    places = np.concatenate((rng.random((4096, 3)), rng.random((4096, 3)) + 9.0))
    expected = np.ones(len(places))
    lower(points, places, expected, 1)
    for flip in (False, True) * 20:
        distance = np.ones(len(places))
        lower(points, places[::-1].copy() if flip else places, distance, 2)
        assert np.array_equal(distance[::-1] if flip else distance, expected)
