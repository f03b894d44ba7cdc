"""Goals for a navigation that is not ours: actions end, and goals are taken back whatever else fails."""

import itertools
import math
import threading
from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from anm_mj.errors import RobotError
from anm_mj.io.ros_messages import RosMessages
from anm_mj.loop_state import LoopState
from anm_mj.ros import live_robot
from anm_mj.ros.commander import Commander
from anm_mj.ros.drive_config import DriveConfig
from anm_mj.ros.health import Health
from anm_mj.ros.live_robot import LiveRobot
from anm_mj.ros.navigation import GoalDriver, Navigation, Told
from anm_mj.ros.poses import Poses
from anm_mj.ros.rgbd_intake import RgbdIntake
from anm_mj.types import Action, Plan, Pose2
from tests.box_room import observe
from tests.ros.fake_ros_robot import CAMERA, T_BASE_CAMERA


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


def driver_at(pose: Pose2, path_xy_m: np.ndarray, told: Told) -> tuple[GoalDriver, Mock]:
    """Drives a robot that stays where it is; the map is the frame of the odometry."""
    poses = Mock(Poses, latest_s=3.0)
    poses.base.return_value = poses.wait_newer.return_value = pose
    navigation, state = Mock(Navigation, told=told), LoopState(40)
    state.observation = replace(observe(0, pose), time_s=3.0)
    state.plan = Plan("go", path_xy_m)
    return GoalDriver(navigation, poses, Mock(Health, **{"present.return_value": None}), state), navigation


@pytest.mark.parametrize(
    ("action", "path_xy_m"),
    [
        (Action.WAIT, np.zeros((0, 2))),
        (Action.MOVE_FORWARD, np.zeros((0, 2))),
        (Action.MOVE_FORWARD, np.array([[1.05, 2.0]])),
        (Action.TURN_LEFT, np.zeros((0, 2))),
    ],
    ids=["wait", "no target", "at the target", "turn"],
)
def test_an_action_ends_though_the_navigation_has_reached_its_goal_at_once(action, path_xy_m):
    driver, navigation = driver_at(Pose2(1.0, 2.0, 0.0), path_xy_m, Told(is_over=True, reached=True))
    looks = itertools.count()
    driver.act(action, lambda: next(looks) == 200)
    assert next(looks) < 10
    assert navigation.send.call_count <= 2


@pytest.mark.parametrize(("moves_m", "cannot"), [(0.05, False), (0.001, True)])
def test_a_goal_that_is_reached_ends_the_plan(moves_m, cannot):
    driver, _ = driver_at(Pose2(1.0, 2.0, 0.0), np.array([[1.15, 2.0]]), Told(is_over=True, reached=True))
    driver._poses.wait_newer.return_value = Pose2(1.0 + moves_m, 2.0, 0.0)
    assert driver.act(Action.MOVE_FORWARD, lambda: False) == cannot
    assert driver._state.follower.next_action(Pose2(1.0, 2.0, 0.0)) is None


def test_a_forward_move_without_a_target_is_a_goal_ahead():
    driver, navigation = driver_at(Pose2(1.0, 2.0, math.pi / 2), np.zeros((0, 2)), Told())
    looks = itertools.count()
    driver.act(Action.MOVE_FORWARD, lambda: next(looks) == 1)
    (goal, _), _ = navigation.send.call_args
    assert (goal.x_m, goal.y_m, goal.yaw_rad) == pytest.approx((1.0, 3.0, math.pi / 2))


def test_a_robot_that_waits_does_not_drive_on_to_its_goal():
    driver, navigation = driver_at(Pose2(1.0, 2.0, 0.0), np.array([[3.0, 2.0]]), Told())
    looks = itertools.count()
    driver.act(Action.MOVE_FORWARD, lambda: next(looks) == 1)
    navigation.cancel.assert_not_called()
    assert not driver.act(Action.WAIT, lambda: False)
    navigation.cancel.assert_called_once()
    navigation.send.assert_called_once()


def test_an_image_has_the_pose_of_its_moment_while_the_robot_drives_on(monkeypatch):
    monkeypatch.setattr(live_robot, "_PATIENCE_S", 10.0)
    make, health = RosMessages(), Health(0.2)
    poses, intake = Poses(health, ""), RgbdIntake(health, 0.001, 0.03)
    poses.source = "the odometry on /odom"
    robot = LiveRobot(intake, poses, Mock(Commander), health, DriveConfig("live", pose="odometry"))
    robot.goals, robot.step = Mock(GoalDriver), 1
    poses.hear_frames(make.transforms(0.0, [("base_link", "camera", T_BASE_CAMERA)]), 1, static=True)
    poses.hear_odometry(make.odometry(10.0, "odom", "base_link", Pose2(0.0, 0.0, 0.0)))
    intake.hear_camera(make.camera_info(0.0, "camera", CAMERA))
    shape = CAMERA.height, CAMERA.width
    intake.hear_colour(make.image(10.05, "camera", np.zeros((*shape, 3), np.uint8)))
    intake.hear_depth(make.image(10.05, "camera", np.ones(shape, np.float32)))

    # Ten poses a second, of a robot that turns by 1 rad/s.
    late = make.odometry(10.1, "odom", "base_link", Pose2(0.0, 0.0, 0.1))
    threading.Timer(0.05, poses.hear_odometry, [late]).start()
    assert robot.observe().pose.yaw_rad == pytest.approx(0.05)
