"""The robot driven by wheel torque and contact, judged by where MuJoCo says that it is."""

import math

import mujoco
import numpy as np
import pytest

from anm_mj.control.action_motion import action_motion
from anm_mj.errors import RobotError
from anm_mj.frames import move_pose, wrap_angle
from anm_mj.sim.drives.physics_drive import PhysicsDrive
from anm_mj.types import Action, Pose2, StopReason, Twist
from tests.robots import let_wheel_stick

_WALL_AT_1M = '<geom type="box" pos="1.05 0 1" size="0.05 3 1"/>'


@pytest.fixture
def make_drive(compile_scene, description):
    def make(obstacles: str = "", start: Pose2 | None = None):
        model, data = compile_scene(obstacles)
        drive = PhysicsDrive(model, data, description)
        drive.place(start or Pose2(0.0, 0.0, 0.0))
        return drive, data

    return make


def test_mixed_actions_do_not_drift(make_drive):
    drive, _ = make_drive(start=Pose2(0.5, -1.0, 0.7))
    commanded = drive.pose
    rng = np.random.default_rng(0)
    for action in rng.choice([Action.MOVE_FORWARD, Action.MOVE_FORWARD, Action.TURN_LEFT, Action.TURN_RIGHT], 30):
        commanded = move_pose(commanded, *action_motion(Action(action)))
        result = drive.act(Action(action))
        error_m = math.hypot(drive.pose.x_m - commanded.x_m, drive.pose.y_m - commanded.y_m)
        assert not result.collided
        assert error_m < 0.005
        assert abs(wrap_angle(drive.pose.yaw_rad - commanded.yaw_rad)) < math.radians(0.5)
    assert drive._reference.x_m == pytest.approx(commanded.x_m, abs=1e-9)


def test_the_robot_stands_after_each_action(make_drive):
    drive, data = make_drive()
    for action in (Action.MOVE_FORWARD, Action.TURN_LEFT, Action.MOVE_FORWARD, Action.TURN_RIGHT):
        drive.act(action)
        assert np.linalg.norm(data.qvel[:3]) < 0.006
        assert abs(data.qvel[5]) < 0.02


def test_turns_add_up(make_drive):
    drive, _ = make_drive()
    for _ in range(36):
        drive.act(Action.TURN_LEFT)
    assert abs(drive.pose.yaw_rad) < math.radians(0.1)
    assert math.hypot(drive.pose.x_m, drive.pose.y_m) < 0.005


def test_wheel_odometry_tells_what_physics_did(make_drive, kinematics):
    drive, data = make_drive()
    estimate = drive.pose
    for action in (Action.MOVE_FORWARD, Action.MOVE_FORWARD, Action.TURN_LEFT, Action.MOVE_FORWARD):
        before_s = data.time
        speeds = drive.act(action).wheel_speeds
        took_s = data.time - before_s
        estimate = kinematics.odometry(estimate, speeds.left_radps * took_s, speeds.right_radps * took_s)
    assert (estimate.x_m, estimate.y_m) == pytest.approx((drive.pose.x_m, drive.pose.y_m), abs=0.002)
    assert estimate.yaw_rad == pytest.approx(drive.pose.yaw_rad, abs=math.radians(0.5))


@pytest.mark.parametrize("yaw_deg", [0.0, 30.0, -55.0])
def test_wall_stops_the_robot(make_drive, yaw_deg):
    drive, data = make_drive(_WALL_AT_1M, Pose2(0.7, 0.0, math.radians(yaw_deg)))
    collided = [drive.act(Action.MOVE_FORWARD).collided for _ in range(12)]
    assert collided[-3:] == [True, True, True]
    # The shell's radius is 0.17 m; a contact gives way by less than a millimetre.
    assert 0.7 < drive.pose.x_m < 1.0 - 0.17 + 0.001
    assert abs(data.body("base").xpos[2]) < 0.002
    assert data.body("base").xmat[8] > 0.9999
    stopped = drive.pose
    assert drive._reference == stopped
    for _ in range(18):
        assert not drive.act(Action.TURN_LEFT).collided
    assert not drive.act(Action.MOVE_FORWARD).collided
    assert drive.pose.x_m < stopped.x_m


def test_a_wall_at_the_side_is_driven_along(make_drive):
    drive, _ = make_drive('<geom type="box" pos="0 0.2201 1" size="5 0.05 1"/>')
    for _ in range(5):
        assert not drive.act(Action.MOVE_FORWARD).collided
    assert drive.pose.x_m == pytest.approx(5 * 0.065, abs=0.005)


@pytest.mark.parametrize("yaw_deg", [0.0, 8.0, 40.0])
def test_servo_stops_before_contact(make_drive, yaw_deg):
    drive, data = make_drive(_WALL_AT_1M, Pose2(0.6, 0.0, math.radians(yaw_deg)))
    touched = []
    wall = int(np.flatnonzero(data.model.geom_type == mujoco.mjtGeom.mjGEOM_BOX)[0])
    for _ in range(6):
        collided = drive.act(Action.MOVE_FORWARD).collided
        touched += [list(contact.geom) for contact in data.contact if wall in contact.geom]
    assert collided
    assert not touched
    # The body's radius is 0.17 m, and the servo keeps 5 mm.
    assert drive.pose.x_m == pytest.approx(1.0 - 0.17 - 0.005, abs=5e-4)
    assert drive.pose.yaw_rad == pytest.approx(math.radians(yaw_deg), abs=1e-3)


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0), (-0.6, 0.8)])
def test_push_against_a_wall(make_drive, direction):
    x, y = direction
    yaw = math.atan2(y, x)
    # A wall 0.3 m away from the robot's middle, square to the push.
    at = f'pos="{0.35 * x} {0.35 * y} 1" euler="0 0 {math.degrees(yaw)}"'
    drive, data = make_drive(f'<geom type="box" size="0.05 3 1" {at}/>')
    base = data.body("base").id
    for _ in range(500):
        data.xfrc_applied[base, :3] = (60.0 * x, 60.0 * y, 0.0)
        mujoco.mj_step(data.model, data)
        pose = drive.pose
        # It hits the wall at more than a metre per second; contacts give way by a centimetre for a moment.
        assert pose.x_m * x + pose.y_m * y < 0.3 - 0.17 + 0.015
        assert data.body("base").xmat[8] > 0.99
    assert drive.pose.x_m * x + drive.pose.y_m * y < 0.3 - 0.17 + 0.002
    data.xfrc_applied[base] = 0.0
    drive.act(Action.TURN_LEFT)
    drive.act(Action.TURN_LEFT)
    # What no wheel can undo is taken for the commanded pose, and the turns stay turns on the spot.
    assert math.hypot(drive.pose.x_m - drive._reference.x_m, drive.pose.y_m - drive._reference.y_m) < 0.006
    pushed_to = drive.pose
    for _ in range(4):
        drive.act(Action.TURN_RIGHT)
    assert math.hypot(drive.pose.x_m - pushed_to.x_m, drive.pose.y_m - pushed_to.y_m) < 0.006


def test_obstacle_at_head_height(make_drive):
    drive, data = make_drive('<geom type="box" pos="0.5 0 1.3" size="0.2 1 0.04"/>')
    collided = [drive.act(Action.MOVE_FORWARD).collided for _ in range(8)]
    assert collided[-1]
    assert drive.pose.x_m < 0.3
    assert data.body("base").xmat[8] > 0.9999


def test_obstacle_below_the_shell(make_drive):
    drive, data = make_drive('<geom type="box" pos="0.5 0 0.02" size="0.2 1 0.02"/>')
    collided = [drive.act(Action.MOVE_FORWARD).collided for _ in range(6)]
    assert collided[-1]
    assert data.body("base").xmat[8] > 0.99


def test_the_same_actions_give_the_same_bits(make_drive):
    def drive_once() -> list[float]:
        drive, data = make_drive(_WALL_AT_1M, Pose2(0.75, 0.0, 0.2))
        for action in (Action.MOVE_FORWARD, Action.TURN_LEFT, Action.MOVE_FORWARD, Action.MOVE_FORWARD):
            drive.act(action)
        return data.qpos.tolist()

    assert drive_once() == drive_once()


def test_a_scene_without_the_robot_is_refused(compile_scene, description):
    with pytest.raises(RobotError, match='no joint "other/base"'):
        PhysicsDrive(*compile_scene(), description, prefix="other/")


@pytest.mark.parametrize("left", [True, False])
def test_a_wheel_that_sticks_is_noticed_at_once_and_given_up_after_six_actions(make_drive, left, caplog):
    drive, data = make_drive()
    assert drive.act(Action.MOVE_FORWARD).fault is None
    let_wheel_stick(data.model, left=left)
    first = drive.act(Action.MOVE_FORWARD)
    speeds = first.wheel_speeds
    assert abs(speeds.left_radps if left else speeds.right_radps) < 0.01
    turns = [Action.TURN_LEFT, Action.TURN_RIGHT, Action.MOVE_FORWARD, Action.TURN_LEFT, Action.MOVE_FORWARD]
    faults = [drive.act(action).fault for action in turns]
    assert faults == [None] * 4 + [StopReason.WHEEL_STUCK]
    (said,) = [record.message for record in caplog.records]
    assert said.startswith(f"The {'left' if left else 'right'} wheel turned by 0.0")


@pytest.mark.parametrize("twist", [Twist(0.0, 1.0), Twist(0.05, 0.0)])
def test_a_wheel_that_sticks_is_given_up_at_velocities_too(make_drive, twist):
    drive, data = make_drive()
    let_wheel_stick(data.model, left=True)
    assert StopReason.WHEEL_STUCK in {drive.drive(twist, 0.2).fault for _ in range(30)}


def test_wheels_that_turn_to_and_fro_do_not_stick(make_drive):
    drive, _ = make_drive()
    random = np.random.default_rng(0)
    twists = [Twist(forward, turn) for forward in (-0.5, 0.0, 0.05, 0.5) for turn in (-1.8, -0.3, 0.0, 1.8)]
    assert {drive.drive(twists[k], 0.05).fault for k in random.integers(len(twists), size=100)} == {None}
