"""Whether something is in the way of a robot that is driven over ROS, by depth alone."""

import math

import numpy as np
import pytest

from anm_mj.ros.commander import free_way_m, is_way_blocked
from anm_mj.ros.drive_config import RosConfig
from tests.mapping.ray_room import CAMERA_HEIGHT_M, Room, camera_pose

HALF_WIDTH_M, HEIGHTS_M = 0.2, (0.05, 1.3)
T_BASE_CAMERA = camera_pose(0.0, 0.0, CAMERA_HEIGHT_M, 0.0)
POST = (np.array([2.0, 1.4, 0.0]), np.array([2.2, 1.6, 1.1]))


def way_m(room, y_m=1.5, heights_m=HEIGHTS_M, spoil=lambda depth_m: None):
    seen = room.observe(1.0, y_m, 0.0, size=128)
    depth_m = seen.depth_m.copy()
    spoil(depth_m)
    return free_way_m(depth_m, seen.intrinsics, T_BASE_CAMERA, HALF_WIDTH_M, heights_m)


def test_the_way_ends_at_what_stands_in_it_and_at_nothing_beside_it():
    assert way_m(Room(furniture=(POST,))) == pytest.approx(1.0, abs=0.02)
    assert way_m(Room(furniture=(POST,)), y_m=1.0) == pytest.approx(3.0, abs=0.02)


def test_what_passes_over_or_under_the_robot_is_in_nobodys_way():
    assert way_m(Room(furniture=(POST,)), heights_m=(1.15, 1.3)) == pytest.approx(3.0, abs=0.02)


def test_single_points_are_noise_and_no_depth_is_free():
    def speckle(depth_m):
        depth_m[64, [60, 64, 68]] = 0.3

    assert way_m(Room(furniture=()), spoil=speckle) == pytest.approx(3.0, abs=0.02)
    assert way_m(Room(), spoil=lambda depth_m: depth_m.fill(np.nan)) == math.inf


def test_a_fast_robot_stops_earlier_unless_it_is_to_stop_before():
    config = RosConfig()
    near_m = config.radius_m + config.clearance_m
    assert is_way_blocked(near_m - 0.01, 0.0, math.inf, config)
    assert not is_way_blocked(near_m + 0.01, 0.0, math.inf, config)
    assert is_way_blocked(near_m + 0.01, 0.3, math.inf, config)
    assert not is_way_blocked(near_m + 0.01, 0.3, 0.005, config)
