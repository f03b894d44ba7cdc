import itertools
import math

import numpy as np
import pytest

from anm_mj.frames import move_pose
from anm_mj.types import Pose2
from scripts.continuous_control import SPEED_MPS, TURN_RADPS, Pursuit

PATH = np.array([[0.0, 0.0], [1.5, 0.0], [1.5, 1.2], [0.4, 2.0]])
PERIOD_S = 0.1


def to_path(xy_m):
    along = [
        a + np.clip(np.dot(xy_m - a, b - a) / np.dot(b - a, b - a), 0, 1) * (b - a) for a, b in itertools.pairwise(PATH)
    ]
    return min(np.linalg.norm(point - xy_m) for point in along)


@pytest.mark.parametrize("yaw_deg", [0, 90, 180, -60])
def test_pursuit_of_a_path_with_corners(yaw_deg):
    pose, pursuit = Pose2(0.0, 0.0, math.radians(yaw_deg)), Pursuit(PATH)
    for count in itertools.count():
        twist = pursuit.twist(pose)
        if twist is None:
            break
        assert count < 300
        assert 0.0 <= twist.forward_mps <= SPEED_MPS
        assert abs(twist.turn_radps) <= TURN_RADPS + 1e-9
        pose = move_pose(pose, twist.forward_mps * PERIOD_S, twist.turn_radps * PERIOD_S)
        assert to_path(pose.xy_m) < 0.2
    assert math.dist(pose.xy_m, PATH[-1]) < 0.1


def test_pursuit_returns_to_the_path():
    pose, pursuit = Pose2(0.2, 0.6, 0.0), Pursuit(PATH)
    for _ in range(60):
        twist = pursuit.twist(pose)
        assert twist is not None
        pose = move_pose(pose, twist.forward_mps * PERIOD_S, twist.turn_radps * PERIOD_S)
        if pose.x_m > 1.2:
            break
    assert abs(pose.y_m) < 0.1
