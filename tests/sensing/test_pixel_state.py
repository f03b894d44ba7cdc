import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.mapping_config import OccupancyConfig
from anm_mj.sensing.pixel_state import (
    AGREEMENT,
    BLOCK_PX,
    LEAST_M,
    find_outliers,
    free_space_depth,
    judge_pixels,
    missing_blocks,
    valid_pixels,
)
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, Intrinsics, PixelState, Pose2
from tests.fake_robot import FakeRobot
from tests.mapping.ray_room import camera_pose
from tests.planning.worlds import room

CAMERA = Intrinsics.from_fov(128, 128, math.pi / 2)
HEIGHT_M = 1.0
RANGE_M = 6.0
USUAL = OccupancyConfig()


def hall(end_m=math.inf):
    """Depth that a level camera has of a floor, and of a wall at ``end_m`` across it."""
    down = (np.arange(CAMERA.height) + 0.5 - CAMERA.cy) / CAMERA.fy
    with np.errstate(divide="ignore"):
        floor_m = np.where(down > 0.0, HEIGHT_M / down, np.inf)
    return np.repeat(np.minimum(floor_m, end_m)[:, None], CAMERA.width, axis=1).astype(np.float32)


def measured(depth_m):
    """The same by a camera that cannot say that it looked farther than its range."""
    return np.where(depth_m <= RANGE_M, depth_m, np.float32(np.nan))


def ahead(depth_m, distance_m, *, config=USUAL, range_m=RANGE_M):
    """State at the camera's height at a distance straight ahead, after one view."""
    grid = DepthOccupancy(config)
    grid.integrate(depth_m, CAMERA, camera_pose(0.0, 0.0, HEIGHT_M, 0.0), range_m)
    return grid.state_at(np.array([[distance_m, 0.0, HEIGHT_M]]))[0]


def test_the_end_of_a_long_hall_is_looked_through():
    view = measured(hall(9.0))
    assert np.isnan(view[: CAMERA.height // 2]).all()
    assert ahead(view, 4.0) == FREE
    assert ahead(view, 4.0, range_m=math.inf) == UNKNOWN
    assert ahead(view, 4.0, config=OccupancyConfig(no_depth_is_free=False)) == UNKNOWN


@pytest.mark.parametrize("distance_m", [1.0, 2.5, 4.0])
def test_what_is_dark_and_stands_on_the_floor_is_not_looked_through(distance_m):
    view = hall(distance_m)
    view[view == distance_m] = np.nan
    assert np.isnan(free_space_depth(view, RANGE_M)[: CAMERA.height // 2]).all()
    assert ahead(view, 0.9 * distance_m) == UNKNOWN


def test_a_dark_wall_within_the_range_ends_what_is_free_before_it():
    view = hall(4.8)
    view[view == np.float32(4.8)] = np.nan
    free_m = free_space_depth(view, RANGE_M)
    assert np.nanmax(free_m) <= 4.8
    assert ahead(view, 4.9) == UNKNOWN


def test_below_something_near_nothing_is_looked_through():
    view = measured(hall(9.0))
    view[: CAMERA.height // 4] = 2.0
    assert np.isnan(free_space_depth(view, RANGE_M)[CAMERA.height // 4 : CAMERA.height // 2]).all()
    assert ahead(view, 4.0) == UNKNOWN


def test_without_a_floor_below_nothing_is_looked_through():
    view = measured(hall(9.0))[: CAMERA.height // 2]
    assert np.isnan(free_space_depth(view, RANGE_M)).all()
    blind = np.full_like(view, np.nan)
    assert np.isnan(free_space_depth(blind, RANGE_M)).all()


def test_a_few_near_pixels_within_a_missing_block_close_it():
    view = measured(hall(9.0))
    row = CAMERA.height // 4 // BLOCK_PX * BLOCK_PX
    view[row, 64:68] = 1.5
    free_m = free_space_depth(view, RANGE_M)
    assert np.isnan(free_m[row + 1, 64:68]).all()
    assert np.isfinite(free_m[row + 1, :32]).all()


def test_what_a_sensor_says_it_looked_at_too_far_is_free_up_to_its_range():
    view = hall(9.0)
    view[view > 1.5] = np.inf
    assert ahead(view, 1.2, range_m=1.5) == FREE
    assert ahead(view, 2.5, range_m=1.5) == UNKNOWN
    assert ahead(view, 2.5, range_m=math.inf) == FREE


def test_a_wall_that_is_measured_stays_where_it_is():
    view = hall(3.0)
    assert ahead(view, 3.0) == OCCUPIED
    np.testing.assert_array_equal(free_space_depth(view, RANGE_M), view)


def test_rims_that_fill_no_block_are_left_as_they_are():
    view = measured(hall(9.0))[:, :-3]
    assert missing_blocks(np.isnan(view)).shape == (16, 15)
    free_m = free_space_depth(view, RANGE_M)
    assert np.isnan(free_m[: CAMERA.height // 2, 120:]).all()
    assert np.isfinite(free_m[: CAMERA.height // 2, :120]).all()


def test_a_judged_frame_says_what_each_pixel_is_and_is_judged_once():
    seen = FakeRobot(room(5, 4), Pose2(1.0, 1.5, 0.0)).observe()
    view, outliers = np.full_like(seen.depth_m, 3.0), np.zeros(seen.depth_m.shape, bool)
    view[:2, :3] = [[1.0, np.inf, np.nan], [0.0, -1.0, 2.0]]
    outliers[1, 2] = True
    seen = replace(seen, depth_m=view)
    judged = judge_pixels(seen, outliers)
    measured, far, lost, outlier, _ = PixelState
    np.testing.assert_array_equal(judged.pixel_state[:2, :3], [[measured, far, lost], [lost, lost, outlier]])
    np.testing.assert_array_equal(judged.depth_m[:2, :3], [[1.0, np.inf, np.nan], [np.nan] * 3])
    np.testing.assert_array_equal(valid_pixels(judged)[:2, :3], [[True, True, False], [False] * 3])
    np.testing.assert_array_equal(valid_pixels(seen)[:2, :3], [[True, True, False], [False, False, True]])
    assert (judged.pixel_state[2:] == measured).all()
    assert judge_pixels(judged) is judged


def counted_outliers(depth_m, support):
    """Outliers by counting the neighbours of every pixel one by one."""
    expected = np.zeros(depth_m.shape, bool)
    for row, col in np.ndindex(depth_m.shape):
        own = depth_m[row, col]
        if not (np.isfinite(own) and own > 0):
            continue
        beside = depth_m[max(row - 1, 0) : row + 2, max(col - 1, 0) : col + 2]
        agreeing = np.count_nonzero(
            np.isfinite(beside)
            & (beside > 0)
            & (np.abs(beside - own) <= max(np.float32(AGREEMENT) * own, np.float32(LEAST_M)))
        )
        # It agrees with itself.
        expected[row, col] = agreeing - 1 < support
    return expected


DEPTH = st.sampled_from([np.nan, np.inf, 0.0, -1.0, 0.3, 0.34, 0.36, 1.0, 1.09, 1.11, 1.2, 3.0]).map(np.float32)


@given(hnp.arrays(np.float32, hnp.array_shapes(min_dims=2, max_dims=2, max_side=6), elements=DEPTH), st.integers(1, 5))
def test_outliers_are_those_that_too_few_of_eight_neighbours_agree_with(depth_m, support):
    assert np.array_equal(find_outliers(depth_m, support), counted_outliers(depth_m, support))


@given(st.integers(0, 1 << 30), st.integers(1, 3))
def test_outliers_at_depths_of_every_size(seed, support):
    rng = np.random.default_rng(seed)
    # Neighbours that differ by about as much as may be.
    depth_m = np.exp(rng.uniform(-3.0, 3.0)) * (1.0 + rng.uniform(-0.12, 0.12, (9, 11)))
    depth_m[rng.random(depth_m.shape) < 0.3] = np.nan
    depth_m = depth_m.astype(np.float32)
    assert np.array_equal(find_outliers(depth_m, support), counted_outliers(depth_m, support))
