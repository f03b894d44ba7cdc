"""Goals of a navigation that is not ours are taken back whatever else fails."""

from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np

from anm_mj.errors import RobotError
from anm_mj.loop_state import LoopState
from anm_mj.ros.health import Health
from anm_mj.ros.navigation import GoalDriver, Navigation
from anm_mj.ros.poses import Poses
from anm_mj.types import Action, Plan, Pose2


def test_a_goal_is_taken_back_where_nobody_knows_where_the_robot_is():
    here = Pose2(1.0, 2.0, 0.5)
    poses = Mock(Poses, latest_s=3.0)
    poses.base.return_value = here
    poses.wait_newer.return_value = Pose2(1.1, 2.0, 0.5)
    navigation = Mock(Navigation, told=SimpleNamespace(is_over=False, reached=False))
    state = LoopState(40)
    state.plan = Plan("go", np.array([[3.0, 2.0]]))
    driver = GoalDriver(navigation, poses, Mock(Health, **{"present.return_value": None}), state)
    assert not driver.act(Action.MOVE_FORWARD, lambda: False)
    navigation.send.assert_called_once()

    poses.base.side_effect = RobotError("tf is no tree")
    driver.stop()
    navigation.cancel.assert_called_once_with(here, 3.0)
    driver.stop()
    navigation.cancel.assert_called_once()
