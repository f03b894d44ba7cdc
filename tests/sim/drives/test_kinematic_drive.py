import math

import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from anm_mj.errors import RobotError
from anm_mj.frames import move_pose
from anm_mj.sim.drives.kinematic_drive import KinematicDrive
from anm_mj.types import FORWARD_STEP_M, TURN_STEP_RAD, Action, Pose2, WheelSpeeds
from tests.robots import clearance_of

_EXACT = 1e-9


@pytest.fixture
def drive(compile_scene, description) -> KinematicDrive:
    """A robot at the origin that looks at a wall at x = 1."""
    wall = trimesh.creation.box(bounds=[[1.0, -3.0, 0.0], [1.1, 3.0, 2.5]])
    return KinematicDrive(*compile_scene(), description, clearance_of(wall))


def test_forward_step(drive):
    drive.place(Pose2(0.2, -0.1, 2.0))
    result = drive.act(Action.MOVE_FORWARD)
    expected = move_pose(Pose2(0.2, -0.1, 2.0), FORWARD_STEP_M, 0.0)
    assert (drive.pose.x_m, drive.pose.y_m) == pytest.approx((expected.x_m, expected.y_m), abs=_EXACT)
    assert drive.pose.yaw_rad == pytest.approx(2.0, abs=_EXACT)
    assert not result.collided
    assert result.moved_m == FORWARD_STEP_M
    assert result.wheel_speeds.left_radps == result.wheel_speeds.right_radps > 0.0


def test_wheel_angles(compile_scene, description):
    model, data = compile_scene()
    free = clearance_of()
    drive = KinematicDrive(model, data, description, free)
    for action in (Action.MOVE_FORWARD, Action.TURN_LEFT, Action.TURN_LEFT, Action.MOVE_FORWARD):
        drive.act(action)
    left, right = data.joint("wheel_left").qpos[0], data.joint("wheel_right").qpos[0]
    assert (left + right) / 2.0 * 0.05 == pytest.approx(2 * FORWARD_STEP_M, abs=_EXACT)
    assert (right - left) * 0.05 / 0.30 == pytest.approx(2 * TURN_STEP_RAD, abs=_EXACT)


@pytest.mark.parametrize("action", [Action.TURN_LEFT, Action.TURN_RIGHT])
def test_full_rotation(drive, action):
    start = Pose2(0.3, 0.4, 0.123)
    drive.place(start)
    for _ in range(36):
        assert drive.act(action).moved_m == 0.0
    assert drive.pose.yaw_rad == pytest.approx(start.yaw_rad, abs=_EXACT)
    assert (drive.pose.x_m, drive.pose.y_m) == pytest.approx((start.x_m, start.y_m), abs=_EXACT)


@given(actions=st.lists(st.sampled_from([Action.MOVE_FORWARD, Action.TURN_LEFT, Action.TURN_RIGHT]), max_size=40))
@settings(max_examples=25, deadline=None)
def test_actions_add_up(compile_scene, description, actions):
    free = clearance_of()
    drive = KinematicDrive(*compile_scene(), description, free)
    x = y = 0.0
    turns = 0
    for action in actions:
        drive.act(action)
        turns += (action == Action.TURN_LEFT) - (action == Action.TURN_RIGHT)
        if action == Action.MOVE_FORWARD:
            x += FORWARD_STEP_M * math.cos(turns * TURN_STEP_RAD)
            y += FORWARD_STEP_M * math.sin(turns * TURN_STEP_RAD)
    assert (drive.pose.x_m, drive.pose.y_m) == pytest.approx((x, y), abs=_EXACT)


def test_blocked_move_is_refused(drive):
    drive.place(Pose2(1.0 - 0.18 - 0.05, 0.0, 0.3))
    before = drive.pose
    for _ in range(3):
        result = drive.act(Action.MOVE_FORWARD)
        assert result.collided
        assert (result.moved_m, result.wheel_speeds) == (0.0, WheelSpeeds(0.0, 0.0))
        assert drive.pose == before
    for _ in range(9):
        assert not drive.act(Action.TURN_LEFT).collided
    assert not drive.act(Action.MOVE_FORWARD).collided


def test_simulated_time(compile_scene, description):
    model, data = compile_scene()
    free = clearance_of()
    drive = KinematicDrive(model, data, description, free)
    drive.act(Action.STOP)
    assert (data.time, drive.pose) == (0.0, Pose2(0.0, 0.0, 0.0))
    drive.act(Action.MOVE_FORWARD)
    assert data.time == pytest.approx(2.0 * math.sqrt(0.065 / 1.5))


def test_a_scene_without_the_robot_is_refused(compile_scene, description):
    free = clearance_of()
    with pytest.raises(RobotError, match='no joint "robot/base"'):
        KinematicDrive(*compile_scene(), description, free, prefix="robot/")
