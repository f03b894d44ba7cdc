"""What the field says about free and occupied, against an exact field and depth with noise."""

import math
from dataclasses import replace

import numpy as np
import pytest

from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.field_occupancy import HIT_SHARE, STRAY_PIXELS, FieldOccupancy
from anm_mj.mapping.mapping_config import OccupancyConfig
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.mapping.occupancy_kernels import BLOCK
from anm_mj.types import FREE, OCCUPIED, UNKNOWN
from anm_mj.utils.arrays import dilate_mask
from tests.mapping.ray_room import Room

VOXEL_M = 0.05


def noisy(observations, sigma_m=0.05):
    """Depth with an error that grows with its square, as that of stereo cameras; ``sigma_m`` at 2 m."""
    rng = np.random.default_rng(0)
    for seen in observations:
        noise = rng.normal(0.0, sigma_m, seen.depth_m.shape) * (seen.depth_m / 2.0) ** 2
        yield replace(seen, depth_m=(seen.depth_m + noise).astype(np.float32))


def fuse(occupancy, observations):
    for seen in observations:
        occupancy.integrate(seen.depth_m, seen.intrinsics, seen.T_world_camera)
    return occupancy


def centres(grid, state):
    return grid.origin_m + (np.argwhere(grid.state == state)[:, ::-1] + 0.5) * grid.resolution_m


@pytest.fixture
def occupancy(room: Room) -> DepthOccupancy:
    return fuse(DepthOccupancy(OccupancyConfig()), noisy(room.turn(1.5, 1.5, 12, size=128)))


def test_noise_leaves_no_obstacle_in_free_space(room, occupancy):
    before = np.abs(room.sdf(centres(occupancy.grid, OCCUPIED)))
    after = room.sdf(centres(FieldOccupancy(occupancy).grid(room.sdf), OCCUPIED))
    assert (before > 0.06).mean() > 0.05
    assert after.max() <= HIT_SHARE * VOXEL_M + 1e-6


def test_surface_stays_occupied(room, occupancy):
    grid = FieldOccupancy(occupancy).grid(room.sdf)
    wall = np.stack([np.zeros(40), np.linspace(0.5, 2.5, 40), np.full(40, 1.2)], axis=1)
    cell = np.floor((wall - grid.origin_m) / grid.resolution_m).astype(int)
    assert (grid.state[cell[:, 2], cell[:, 1], cell[:, 0]] == OCCUPIED).all()


@pytest.fixture
def exact(room: Room) -> DepthOccupancy:
    return fuse(DepthOccupancy(OccupancyConfig()), room.turn(1.5, 1.5, 12, size=128))


def nothing_there(points):
    return np.full(len(points), 0.1, np.float32)


def test_every_hit_of_exact_depth_stands(exact):
    grid = FieldOccupancy(exact).grid(nothing_there)
    assert np.array_equal(grid.state, exact.grid.state)


def test_what_rays_of_exact_depth_passed_stays_free(exact):
    grid = FieldOccupancy(exact).grid(lambda points: np.full(len(points), -0.02, np.float32))
    assert np.array_equal(grid.state, exact.grid.state)


def test_what_noise_let_rays_pass_is_occupied(occupancy):
    state = FieldOccupancy(occupancy).grid(lambda points: np.full(len(points), -0.02, np.float32)).state
    raw = occupancy.grid.state
    beside = dilate_mask(raw == OCCUPIED) & (raw == FREE)
    assert (state[beside] == OCCUPIED).any()
    assert (state[raw == OCCUPIED] == OCCUPIED).all()


def test_hits_that_noise_explains_do_not(occupancy):
    state = FieldOccupancy(occupancy).grid(nothing_there).state
    far = (occupancy.grid.state == OCCUPIED) & (occupancy.grid.seen_range_m > 1.5)
    assert far.any()
    assert (state[far] == FREE).all()


def test_of_a_noisy_sensor_what_was_hit_from_near_stands(room):
    occupancy = DepthOccupancy(OccupancyConfig())
    rng = np.random.default_rng(0)
    for seen in room.turn(1.5, 1.5, 12, size=128):
        noise = 1.0 + 0.004 * seen.depth_m * rng.standard_normal(seen.depth_m.shape)
        fuse(occupancy, [replace(seen, depth_m=(seen.depth_m * noise).astype(np.float32))])
    state = FieldOccupancy(occupancy).grid(nothing_there).state
    hit, seen_m = occupancy.grid.state == OCCUPIED, occupancy.grid.seen_range_m
    assert (state[hit & (seen_m < 1.4)] == OCCUPIED).all()
    assert (state[hit & (seen_m > 1.7)] == FREE).all()


def test_the_field_decides_where_no_image_told_of_the_sensor(exact):
    untold = DepthOccupancy(OccupancyConfig())
    untold.set_arrays({**exact.arrays(), "depth_noise": np.zeros(3)})
    assert not (FieldOccupancy(untold).grid(nothing_there).state == OCCUPIED).any()


def straying(observations, share):
    """Exact depth, but for single pixels of any depth."""
    rng = np.random.default_rng(1)
    for seen in observations:
        wrong = rng.random(seen.depth_m.shape) < share
        depth_m = np.where(wrong, rng.uniform(0.3, 3.0, wrong.shape), seen.depth_m)
        yield replace(seen, depth_m=depth_m.astype(np.float32))


def test_pixels_that_stray_leave_next_to_no_obstacle_in_free_space(room):
    looks = [seen for _ in range(4) for seen in room.turn(1.5, 1.5, 12, size=128)]
    occupancy = fuse(DepthOccupancy(OccupancyConfig()), straying(looks, 0.002))
    assert occupancy.strays.are_known
    raw, state = occupancy.grid, FieldOccupancy(occupancy).grid(room.sdf).state
    apart = np.zeros(raw.state.shape, bool)
    apart[tuple(np.argwhere(raw.state == OCCUPIED)[room.sdf(centres(raw, OCCUPIED)) > 0.1].T)] = True
    assert apart.sum() > 5
    assert (state[apart] == OCCUPIED).mean() < 0.1
    # What many pixels hit stands, whatever the field says.
    often = (raw.state == OCCUPIED) & (occupancy.voxels.num_hits > STRAY_PIXELS)
    nothing = FieldOccupancy(occupancy).grid(nothing_there).state
    assert often.any()
    assert (nothing[often] == OCCUPIED).all()


def test_pixels_that_stray_outside_do_not_make_the_grid_grow(room):
    # The room has walls; what lies beyond them is speckle.
    looks = [seen for _ in range(4) for seen in room.turn(1.5, 1.5, 12, size=128)]
    occupancy = fuse(DepthOccupancy(OccupancyConfig()), straying(looks, 0.002))
    assert occupancy.strays.are_known
    rng, shape = np.random.default_rng(2), occupancy.grid.state.shape
    for seen in looks[:12]:
        depth_m = np.where(rng.random(seen.depth_m.shape) < 0.0005, 9.0, seen.depth_m).astype(np.float32)
        occupancy.integrate(depth_m, seen.intrinsics, seen.T_world_camera)
    assert occupancy.grid.state.shape == shape
    # A second room behind a door is no speckle.
    depth_m = seen.depth_m.copy()
    depth_m[40:80, 40:80] = 9.0
    occupancy.integrate(depth_m, seen.intrinsics, seen.T_world_camera)
    assert np.prod(occupancy.grid.state.shape) > np.prod(shape)


def test_exact_images_hold_no_pixel_that_strays(room):
    looks = [seen for _ in range(4) for seen in room.turn(1.5, 1.5, 12, size=128)]
    assert not fuse(DepthOccupancy(OccupancyConfig()), looks).strays.are_known


def test_poses_that_drift_let_no_pixel_stray(room):
    occupancy, num_in_free_space = DepthOccupancy(OccupancyConfig()), 0
    looks = [seen for _ in range(6) for seen in room.turn(1.5, 1.5, 12, size=128)]
    for number, seen in enumerate(looks):
        drift = np.eye(4)
        drift[:2, 3] = 0.006 * number, -0.004 * number
        before = occupancy.voxels
        free = before.log_odds <= -10 * occupancy.config.miss
        num_hits = before.num_hits.copy()
        fuse(occupancy, [replace(seen, T_world_camera=drift @ seen.T_world_camera)])
        if occupancy.voxels.num_hits.shape == num_hits.shape:
            num_in_free_space += bool((free & (occupancy.voxels.num_hits > num_hits)).any())
    # Surface that the drift has carried into space known as free.
    assert num_in_free_space > 0.2 * len(looks)
    assert not occupancy.strays.are_known


def test_a_map_of_an_older_version_knows_of_no_strays(exact):
    arrays = exact.arrays()
    exact.strays.set_array(np.array([100.0, 50.0]))
    kept = DepthOccupancy(OccupancyConfig())
    kept.set_arrays(exact.arrays())
    assert kept.strays.are_known
    del arrays["strays"]
    kept.set_arrays(arrays)
    assert not kept.strays.are_known
    with pytest.raises(ValueError, match="strays"):
        kept.set_arrays({**arrays, "strays": np.array([-1.0, 0.0])})


def test_a_part_is_of_now_and_the_rest_follows(room, occupancy):
    geometry, whole = FieldOccupancy(occupancy), FieldOccupancy(occupancy)
    geometry.grid(room.sdf)
    whole.grid(room.sdf)
    fuse(occupancy, noisy(room.turn(1.5, 0.7, 6, size=128)))
    fresh = whole.grid(room.sdf).state.copy()
    place, reach = np.array([1.5, 0.7]), 0.3
    part = geometry.grid(room.sdf, np.stack([place - reach, place + reach]))
    rows, cols = (
        slice(*((place[axis] + np.array([-reach, reach]) - part.origin_m[axis]) / VOXEL_M).astype(int))
        for axis in (1, 0)
    )
    assert np.array_equal(part.state[:, rows, cols], fresh[:, rows, cols])
    assert not np.array_equal(part.state, fresh)
    version = part.version
    after = geometry.grid(room.sdf)
    assert np.array_equal(after.state, fresh)
    assert (after.column_version == version).any()


def test_field_decides_nothing_that_was_not_observed(occupancy):
    grid = FieldOccupancy(occupancy).grid(lambda points: np.full(len(points), -0.1, np.float32))
    assert ((grid.state == UNKNOWN) == (occupancy.grid.state == UNKNOWN)).all()


def test_field_frees_nothing_without_a_hit_beside_it(occupancy):
    solid = FieldOccupancy(occupancy).grid(lambda points: np.full(len(points), -0.1, np.float32))
    far = (occupancy.grid.state == FREE) & (solid.state == FREE)
    assert far.sum() > 1000


def test_reading_again_reads_what_came_in(room, occupancy):
    geometry = FieldOccupancy(occupancy)
    geometry.grid(room.sdf)
    asked = []

    def counted(points):
        asked.append(len(points))
        return room.sdf(points)

    geometry.grid(counted)
    assert not asked
    fuse(occupancy, noisy([room.observe(1.5, 1.5, 0.0, size=128)]))
    geometry.grid(counted)
    came_in = sum(asked)
    asked.clear()
    FieldOccupancy(occupancy).grid(counted)
    assert 0 < came_in < sum(asked)


def test_bit_by_bit_is_as_good_as_at_once(room):
    occupancy = DepthOccupancy(OccupancyConfig())
    geometry = FieldOccupancy(occupancy)
    kept = geometry.grid(room.sdf)
    for seen in noisy(room.turn(1.0, 1.0, 6, size=96) + room.turn(3.5, 2.5, 6, size=96)):
        fuse(occupancy, [seen])
        kept = geometry.grid(room.sdf)
    at_once = FieldOccupancy(occupancy).grid(room.sdf)
    assert np.array_equal(kept.state, at_once.state)


def test_what_depth_and_field_agree_on_is_asked_less_often(room):
    occupancy = DepthOccupancy(OccupancyConfig())
    geometry, asked = FieldOccupancy(occupancy), []

    def counted(points):
        asked[-1] += len(points)
        return room.sdf(points)

    for seen in noisy([room.observe(1.5, 1.5, 0.0, size=128)] * 15):
        fuse(occupancy, [seen])
        asked.append(0)
        geometry.grid(counted)
    asked.append(0)
    at_once = FieldOccupancy(occupancy).grid(counted)
    assert np.mean(asked[-7:-1]) < 0.7 * asked[-1]
    assert np.array_equal(geometry.grid(room.sdf).state, at_once.state)


def test_what_the_field_has_learnt_is_read_in_a_few_readings(room, occupancy):
    geometry = FieldOccupancy(occupancy)
    geometry.grid(lambda points: np.full(len(points), -0.02, np.float32))
    for seen in noisy([room.observe(1.5, 1.5, 0.0, size=128)] * 3):
        fuse(occupancy, [seen])
        geometry.grid(room.sdf)
    kept = geometry.grid(room.sdf)
    now = FieldOccupancy(occupancy).grid(room.sdf).state
    block_layers, block_rows, block_cols = np.nonzero(occupancy.voxels.block_stamp >= occupancy.grid.version - 2)
    assert len(block_layers)
    for z, y, x in zip(block_layers * BLOCK, block_rows * BLOCK, block_cols * BLOCK, strict=True):
        block = np.s_[z : z + BLOCK, y : y + BLOCK, x : x + BLOCK]
        assert np.array_equal(kept.state[block], now[block])


def test_changes_are_reported_by_block(room, occupancy):
    geometry = FieldOccupancy(occupancy)
    before = geometry.grid(room.sdf)
    old_state, old_version = before.state.copy(), before.version
    fuse(occupancy, noisy([room.observe(1.5, 0.5, 1.2, size=128)]))
    after = geometry.grid(room.sdf)
    assert after.column_version is not None
    assert after.state.shape == old_state.shape
    moved = (after.state != old_state).any(axis=0)
    rows, cols = (n // BLOCK for n in moved.shape)
    blocks = moved.reshape(rows, BLOCK, cols, BLOCK).any(axis=(1, 3))
    assert blocks.any()
    assert (after.column_version[blocks] > old_version).all()
    assert (after.column_version <= old_version).any()


def test_learned_field_clears_the_floor_that_noise_blocks(tiny_config, room):
    maps = [
        NeuralMap(replace(tiny_config, geometry=geometry), seed=0, device="cpu") for geometry in ("occupancy", "field")
    ]
    for seen in noisy(room.turn(1.5, 1.5, 16, size=96), sigma_m=0.03):
        for neural_map in maps:
            neural_map.integrate(seen)
    blocked = []
    for neural_map in maps:
        grid = neural_map.occupancy_grid()
        low, high = grid.layer_of(0.075), grid.layer_of(0.275)
        points = np.array([[1.5 + 0.9 * math.cos(a), 1.5 + 0.9 * math.sin(a), 0.0] for a in np.linspace(0, 6.28, 200)])
        points = points[room.sdf(points + np.array([0.0, 0.0, 0.3])) > 0.2]
        cell = np.floor((points - grid.origin_m) / grid.resolution_m).astype(int)
        blocked.append(float((grid.state[low:high, cell[:, 1], cell[:, 0]] == OCCUPIED).any(axis=0).mean()))
    assert blocked[1] <= 0.5 * blocked[0]


@pytest.mark.parametrize("reach_m", [math.inf, 1e30])
def test_a_box_without_end_is_the_whole_grid(room, occupancy, reach_m):
    box = np.array([[-reach_m, -reach_m], [reach_m, reach_m]])
    found, whole = (FieldOccupancy(occupancy).grid(room.sdf, each).state for each in (box, None))
    assert (whole != UNKNOWN).any()
    np.testing.assert_array_equal(found, whole)
