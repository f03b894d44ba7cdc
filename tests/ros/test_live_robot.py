"""A live robot over the wire: it executes actions, and stops for everything that may be wrong."""

import math
import re
import threading
import time
from contextlib import nullcontext
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from anm_mj.errors import ConfigError, RobotError
from anm_mj.frames import wrap_angle
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.protocols import Robot
from anm_mj.ros import names
from anm_mj.ros.connect import Connection, connect
from anm_mj.ros.drive import drive
from anm_mj.ros.drive_config import DriveConfig, RosConfig
from anm_mj.ros.node import Node
from anm_mj.types import FORWARD_STEP_M, TURN_STEP_RAD, Action, Pose2
from tests.ros.conftest import wait_until
from tests.ros.fake_ros_robot import T_BASE_CAMERA, FakeRosRobot

pytestmark = pytest.mark.slow
"""They run in real time, which a machine that is busy with other tests does not give them."""

STOPPED_S = 0.3
"""From a fault to a velocity of zero at most [s]."""


def config(**ros) -> DriveConfig:
    return DriveConfig("live", pose="odometry", ros=RosConfig(wait_s=8.0, **ros))


@pytest.fixture(scope="module")
def fake():
    with Node() as its_node, FakeRosRobot(its_node) as made:
        yield made


@pytest.fixture(scope="module")
def connected(fake: FakeRosRobot):
    with connect(config(), lambda: False) as made:
        yield made


@pytest.fixture
def live(fake: FakeRosRobot, connected: Connection) -> Connection:
    """The same robot for all tests: to connect takes a second."""
    fake.broken.clear()
    fake.obstacle_m, fake.pose = math.inf, Pose2(-1.0, 0.0, 0.0)
    time.sleep(0.3)
    wait_until(lambda: connected.health.present() is None)
    connected.robot.act(Action.STOP)
    return connected


def test_actions_are_executed_to_the_millimetre(fake: FakeRosRobot, live: Connection):
    robot = live.robot
    assert isinstance(robot, Robot)
    first = robot.observe()

    forward = robot.act(Action.MOVE_FORWARD)
    after = robot.observe()
    left = robot.act(Action.TURN_LEFT)

    assert not forward.collided
    assert not left.collided
    assert forward.moved_m == pytest.approx(FORWARD_STEP_M, abs=0.005)
    assert after.pose.x_m - first.pose.x_m == pytest.approx(forward.moved_m, abs=1e-6)
    assert after.time_s > first.time_s
    assert robot.observe().pose.yaw_rad == pytest.approx(TURN_STEP_RAD, abs=0.02)
    assert robot.step == 2


def test_errors_of_actions_have_the_mean_zero_and_do_not_add_up(fake: FakeRosRobot, live: Connection):
    off = []
    for number in range(1, 16):
        live.robot.act(Action.TURN_LEFT)
        off.append(wrap_angle(fake.pose.yaw_rad - number * TURN_STEP_RAD))
    assert abs(off[-1]) < math.radians(0.4)
    assert abs(np.mean(off[5:])) < math.radians(0.15)

    for _ in range(12):
        live.robot.act(Action.MOVE_FORWARD)

    heading = 15 * TURN_STEP_RAD
    gone = np.array([math.cos(heading), math.sin(heading)]) * 12 * FORWARD_STEP_M
    np.testing.assert_allclose(fake.pose.xy_m - [-1.0, 0.0], gone, atol=0.005)


def test_an_observation_has_depth_camera_and_poses_of_its_moment(fake: FakeRosRobot, live: Connection):
    seen = live.robot.observe()

    np.testing.assert_allclose(seen.T_world_camera[:3, 3], [-1.0, 0.0, T_BASE_CAMERA[2, 3]], atol=1e-9)
    assert seen.depth_m[24, 32] == pytest.approx(3.0)  # The wall at x = 2 m.
    assert (seen.intrinsics.width, seen.intrinsics.cx) == (64, 32.0)
    assert seen.rgb.shape == (48, 64, 3)


@pytest.mark.parametrize(
    ("broken", "said"),
    [
        ("images", "nothing was heard of the (colour|depth) on /camera/(color|depth)/image_raw for 0.22 s"),
        ("odometry", "nothing was heard of the odometry on /odom for 0.22 s"),
        ("clock", r"the clock of .* jumped by \+30"),
        ("encoding", "/camera/depth/image_raw: its images are colour, not depth"),
        ("size", "gives 32 x 24 pixels after images of 64 x 48"),
    ],
)
def test_it_stops_for_a_fault_and_goes_on_when_it_is_over(fake, live, caplog, broken, said):
    live.robot.observe()
    done = []
    turning = threading.Thread(target=lambda: [done.append(live.robot.act(Action.TURN_LEFT)) for _ in range(3)])
    turning.start()
    wait_until(lambda: fake.speed > 0.3)

    fake.broken.add(broken)
    broke_s = time.monotonic()
    wait_until(lambda: fake.speed == 0.0 and any("The robot stops" in record.message for record in caplog.records))
    stopped_s = next(at for at, *twist in reversed(fake.commands) if any(twist)) - broke_s
    fake.broken.clear()
    turning.join(30.0)

    assert stopped_s < STOPPED_S
    assert [not result.collided for result in done] == [True] * 3
    record = next(record.getMessage() for record in caplog.records if "The robot stops" in record.message)
    assert re.search(said, record), record


def test_an_end_that_comes_while_it_waits_for_an_image_is_no_fault_of_the_camera(fake, live):
    live.robot.observe()
    live.robot.act(Action.TURN_LEFT)
    seen = live.robot.observe()
    fake.broken.add("images")
    time.sleep(0.3)
    live.robot.act(Action.WAIT)
    live.robot.is_over = lambda: True
    try:
        again = live.robot.observe()
    finally:
        live.robot.is_over = lambda: False
    assert again.step == seen.step + 1
    assert again.time_s >= seen.time_s
    np.testing.assert_allclose(again.pose.xy_m, seen.pose.xy_m, atol=0.01)


def test_depth_ahead_stops_it_where_the_map_knows_nothing(fake: FakeRosRobot, live: Connection):
    live.robot.observe()
    fake.obstacle_m = T_BASE_CAMERA[0, 3] + 0.2
    time.sleep(0.2)

    result = live.robot.act(Action.MOVE_FORWARD)

    assert result.collided
    assert result.moved_m < 0.02


def test_wheels_that_do_not_turn_are_an_obstacle(fake: FakeRosRobot, live: Connection):
    fake.broken.add("frozen")

    assert live.robot.act(Action.MOVE_FORWARD).collided


def test_zero_is_the_last_velocity_on_every_way_out(fake: FakeRosRobot):
    class OddError(Exception):
        pass

    def leave_while_driving():
        with connect(config(), lambda: False) as live:
            live.robot.observe()
            threading.Thread(target=lambda: live.robot.act(Action.MOVE_FORWARD), daemon=True).start()
            wait_until(lambda: fake.speed > 0.05)
            raise OddError

    with pytest.raises(OddError):
        leave_while_driving()

    time.sleep(0.2)
    assert fake.commands[-1][1:] == (0.0, 0.0)


def test_a_dry_run_sends_nothing(fake: FakeRosRobot):
    fake.commands.clear()
    dry = DriveConfig("live", pose="odometry", dry=True, ros=RosConfig(wait_s=8.0))
    with connect(dry, lambda: False) as live:
        live.robot.observe()
        assert not live.robot.act(Action.MOVE_FORWARD).collided
        assert live.robot.step == 1
    assert fake.commands == []


def test_compressed_images_and_frames_alone_are_enough():
    """In a namespace of its own."""
    with Node("packed") as its_node, FakeRosRobot(its_node, packed=True):
        wanted = DriveConfig("live", pose="odometry", ros=RosConfig(wait_s=8.0, namespace="packed", odometry="tf"))
        with connect(wanted, lambda: False) as live:
            seen = live.robot.observe()
            turned = live.robot.act(Action.TURN_LEFT)
            after = live.robot.observe()

    assert seen.depth_m[24, 32] == pytest.approx(3.0, abs=1e-3)
    assert seen.rgb[24, 32].tolist() == [140, 180, 220]
    assert not turned.collided
    assert after.pose.yaw_rad == pytest.approx(TURN_STEP_RAD, abs=0.02)


def test_what_is_missing_is_told_in_one_sentence(other: Node):
    """In a namespace of its own, where only this test publishes."""

    def begin(said: str, **ros) -> None:
        with pytest.raises(RobotError, match=said):
            _begin(DriveConfig("live", pose="odometry", ros=RosConfig(wait_s=1.2, namespace="alone", **ros)))

    begin("nobody publishes sensor_msgs/Image or sensor_msgs/CompressedImage for colour in domain")
    held = [other.publisher(f"/alone/{name}/color", names.IMAGE) for name in ("camera", "left")]
    begin("/alone/camera/color, /alone/left/color may be colour; name one by --topic colour=NAME")
    begin("nobody publishes /alone/camera/colour", colour="camera/colour")
    held.append(other.publisher("/alone/odom", names.ODOMETRY_TYPE))
    begin("/alone/odom is of type nav_msgs/Odometry, not sensor_msgs/Image", colour="odom")


def test_senses_that_do_not_fit_together_are_told(fake: FakeRosRobot):
    fake.broken = {"stamps"}
    said = "the stamps of /camera/color/image_raw and /camera/depth/image_raw do not meet: the nearest differ by -5.0"
    with pytest.raises(RobotError, match=said):
        _begin(DriveConfig("live", pose="odometry", ros=RosConfig(wait_s=6.0)))
    fake.broken.clear()
    lost = RosConfig(wait_s=2.0, base_frame="trunk")
    with pytest.raises(RobotError, match="do not say where 'trunk' is on the robot"):
        _begin(DriveConfig("live", pose="odometry", ros=lost))


def _begin(wanted: DriveConfig) -> None:
    with connect(wanted, lambda: False):
        pass


def test_a_robot_that_would_drive_over_what_is_as_high_as_itself_is_refused():
    with pytest.raises(ConfigError, match=r"ros.height_m is 0.04 and ros.low_m 0.05"):
        config(height_m=0.04)


def test_the_patience_is_that_of_the_settings(monkeypatch):
    monkeypatch.setattr("anm_mj.ros.drive._parts", lambda *_, **__: nullcontext())
    begun = Mock(side_effect=KeyboardInterrupt)
    monkeypatch.setattr("anm_mj.ros.drive.run_with", begun)
    with pytest.raises(KeyboardInterrupt):
        drive(replace(config(), planning=PlanningConfig(patience_steps=60)))
    assert begun.call_args.kwargs["state"].patience_steps == 60


def test_true_poses_and_the_oracle_are_refused():
    with pytest.raises(ConfigError, match="--pose is 'true'"):
        DriveConfig("live")
    with pytest.raises(ConfigError, match="Policy oracle needs the true scene"):
        DriveConfig("live", pose="slam", policy="oracle")
    with pytest.raises(RobotError, match="forward_mps is -1"):
        RosConfig(forward_mps=-1.0)
