"""Goals of a navigation that is not ours are taken back whatever else fails."""

import math
from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from anm_mj.errors import RobotError
from anm_mj.loop_state import LoopState
from anm_mj.ros.health import Health
from anm_mj.ros.navigation import GoalDriver, Navigation
from anm_mj.ros.poses import Poses
from anm_mj.types import Action, Plan, Pose2
from tests.box_room import observe


@pytest.mark.parametrize("unknown", [RobotError("tf is no tree"), None])
def test_a_goal_is_taken_back_where_the_robot_was_last_known_to_be(unknown):
    poses = Mock(Poses, latest_s=3.0)
    poses.base.return_value = Pose2(1.0, 2.0, 0.5)
    poses.wait_newer.return_value = Pose2(1.1, 2.0, 0.5)
    navigation = Mock(Navigation, told=SimpleNamespace(is_over=False, reached=False))
    state = LoopState(40)
    state.observation = replace(observe(0, Pose2(5.0, 5.0, 0.5 + math.pi / 2)), time_s=3.0)
    state.plan = Plan("go", np.array([[3.0, 2.0]]))
    driver = GoalDriver(navigation, poses, Mock(Health, **{"present.return_value": None}), state)
    assert not driver.act(Action.MOVE_FORWARD, lambda: False)
    navigation.send.assert_called_once()

    poses.base.side_effect = lambda time_s: None
    if unknown is not None:
        poses.base.side_effect = unknown
    driver.stop()
    (where, when), _ = navigation.cancel.call_args
    # A tenth of a metre along x of the odometry is one along y of the map.
    assert (where.x_m, where.y_m, where.yaw_rad) == pytest.approx((5.0, 5.1, 0.5 + math.pi / 2))
    assert when == 3.0
    driver.stop()
    navigation.cancel.assert_called_once()
