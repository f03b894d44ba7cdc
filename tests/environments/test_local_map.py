"""The map about the robot, in a room that is known exactly."""

import math

import numpy as np
from scipy import ndimage

from anm_mj.environments.local_map import CELLS, MAX_DISTANCE_M, LocalMap
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, Footprint, Pose2
from tests.box_room import observe

_FOOTPRINT = Footprint(radius_m=0.18, z_min_m=0.05, z_max_m=1.35)
_HERE = CELLS // 2


def _seen_all_round(pose: Pose2) -> LocalMap:
    local_map = LocalMap(_FOOTPRINT)
    for i in range(12):
        local_map.add(observe(i, Pose2(pose.x_m, pose.y_m, i * math.radians(30.0))))
    return local_map


def _first_occupied_cells(line: np.ndarray) -> int:
    return int(np.argmax(line == OCCUPIED))


def test_ahead_is_up_and_left_is_left():
    # The room reaches from (-2, -1.5) to (2, 1.5): looking along +y from (1, 0.5), walls stand 1 m ahead, 3 m to the
    # left, 1 m to the right and 2 m behind.
    pose = Pose2(1.0, 0.5, math.pi / 2)
    cells = _seen_all_round(pose).crop(pose)
    assert cells.shape == (CELLS, CELLS)
    ahead, behind = cells[_HERE - 1 :: -1, _HERE], cells[_HERE:, _HERE]
    left, right = cells[_HERE, _HERE - 1 :: -1], cells[_HERE, _HERE:]
    distances_cells = [_first_occupied_cells(line) for line in (ahead, left, right, behind)]
    np.testing.assert_allclose(distances_cells, [20, 60, 20, 40], atol=1)
    assert cells[_HERE, _HERE - 20] == FREE
    assert cells[0, 0] == UNKNOWN


def test_a_turned_robot_sees_the_map_turned():
    local_map = _seen_all_round(Pose2(0.0, 0.0, 0.0))
    towards_x, towards_y = (local_map.crop(Pose2(0.0, 0.0, yaw_rad)) for yaw_rad in (0.0, math.pi / 2))
    # What was ahead is now to the right; rounding to cells differs along their borders.
    assert np.mean(np.rot90(towards_x, -1) == towards_y) > 0.97


def test_no_heading_opens_a_hole_in_a_wall():
    local_map = _seen_all_round(Pose2(0.0, 0.0, 0.0))
    for yaw_deg in range(0, 360, 7):
        cells = local_map.crop(Pose2(0.0125, 0.025, math.radians(yaw_deg)))
        blocked, _ = ndimage.label(cells != OCCUPIED)
        assert blocked[_HERE, _HERE] != blocked[0, 0]


def test_a_single_view_leaves_most_unknown():
    local_map = LocalMap(_FOOTPRINT)
    local_map.add(observe(0, Pose2(-1.0, 0.0, 0.0)))
    cells = local_map.crop(Pose2(-1.0, 0.0, 0.0))
    assert (cells[_HERE + 5 :] == UNKNOWN).all()
    assert (cells[:_HERE] == FREE).any()


def test_signed_distance_to_the_walls():
    pose = Pose2(0.0, 0.0, 0.0)
    local_map = _seen_all_round(pose)
    distance_m = local_map.distance(pose)
    occupied = local_map.crop(pose) == OCCUPIED
    assert (distance_m[occupied] < 0.0).all()
    assert (distance_m[~occupied] > 0.0).all()
    assert abs(distance_m[_HERE, _HERE] - 1.5) < 0.08
    assert abs(distance_m[_HERE - 20, _HERE] - 1.0) < 0.08


def test_without_obstacles_the_distance_is_the_limit():
    distance_m = LocalMap(_FOOTPRINT).distance(Pose2(0.0, 0.0, 0.0))
    assert (distance_m == MAX_DISTANCE_M).all()


def test_area_and_information_grow_with_what_is_seen():
    local_map = LocalMap(_FOOTPRINT)
    assert (local_map.area_m2, local_map.information_bits) == (0.0, 0.0)
    local_map.add(observe(0, Pose2(0.0, 0.0, 0.0)))
    first = local_map.area_m2, local_map.information_bits
    for i in range(1, 12):
        local_map.add(observe(i, Pose2(0.0, 0.0, i * math.radians(30.0))))
    # The room measures 4 m by 3 m; its walls are observed too.
    assert 0.0 < first[0] < local_map.area_m2
    assert 11.0 < local_map.area_m2 < 16.0
    assert 0.0 < first[1] < local_map.information_bits
    assert local_map.information_bits < local_map._grid.voxels.log_odds.size
