import math

import numpy as np
import pytest
from anm_mj.sensing.lost_pixels import BLOCK_PX, lost_squares, vouched_depth

from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.mapping_config import OccupancyConfig
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, Intrinsics
from tests.mapping.ray_room import camera_pose

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
    assert np.isnan(vouched_depth(view, RANGE_M)[: CAMERA.height // 2]).all()
    assert ahead(view, 0.9 * distance_m) == UNKNOWN


def test_a_dark_wall_within_the_range_ends_what_is_free_before_it():
    view = hall(4.8)
    view[view == np.float32(4.8)] = np.nan
    vouched = vouched_depth(view, RANGE_M)
    assert np.nanmax(vouched) <= 4.8
    assert ahead(view, 4.9) == UNKNOWN


def test_below_something_near_nothing_is_looked_through():
    view = measured(hall(9.0))
    view[: CAMERA.height // 4] = 2.0
    assert np.isnan(vouched_depth(view, RANGE_M)[CAMERA.height // 4 : CAMERA.height // 2]).all()
    assert ahead(view, 4.0) == UNKNOWN


def test_without_a_floor_below_nothing_is_looked_through():
    view = measured(hall(9.0))[: CAMERA.height // 2]
    assert np.isnan(vouched_depth(view, RANGE_M)).all()
    blind = np.full_like(view, np.nan)
    assert np.isnan(vouched_depth(blind, RANGE_M)).all()


def test_a_few_near_pixels_within_a_lost_square_close_it():
    view = measured(hall(9.0))
    row = CAMERA.height // 4 // BLOCK_PX * BLOCK_PX
    view[row, 64:68] = 1.5
    vouched = vouched_depth(view, RANGE_M)
    assert np.isnan(vouched[row + 1, 64:68]).all()
    assert np.isfinite(vouched[row + 1, :32]).all()


def test_what_a_sensor_says_it_looked_at_too_far_is_free_up_to_its_range():
    view = hall(9.0)
    view[view > 1.5] = np.inf
    assert ahead(view, 1.2, range_m=1.5) == FREE
    assert ahead(view, 2.5, range_m=1.5) == UNKNOWN
    assert ahead(view, 2.5, range_m=math.inf) == FREE


def test_a_wall_that_is_measured_stays_where_it_is():
    view = hall(3.0)
    assert ahead(view, 3.0) == OCCUPIED
    np.testing.assert_array_equal(vouched_depth(view, RANGE_M), view)


def test_rims_that_fill_no_square_are_left_as_they_are():
    view = measured(hall(9.0))[:, :-3]
    assert lost_squares(view).shape == (16, 15)
    vouched = vouched_depth(view, RANGE_M)
    assert np.isnan(vouched[: CAMERA.height // 2, 120:]).all()
    assert np.isfinite(vouched[: CAMERA.height // 2, :120]).all()
