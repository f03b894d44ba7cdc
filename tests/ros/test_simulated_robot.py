"""The simulated robot as others hear it: what it publishes, and how it follows commands."""

import math
import threading

import numpy as np
import pytest

from anm_mj.errors import ConfigError
from anm_mj.io.ros_messages import seconds
from anm_mj.ros import names
from anm_mj.ros.node import LATCHED, STATE, Node
from anm_mj.ros.simulated_robot import SimulatedRosRobot
from anm_mj.scene.folder import load_scene
from anm_mj.sim.make_robot import make_robot
from anm_mj.sim.sensors.sensor_config import SensorConfig
from anm_mj.types import Pose2
from tests.ros.conftest import wait_until

pytestmark = pytest.mark.slow
"""They run in real time, which a machine that is busy with other tests does not give them."""

RATE = 4.0
START = Pose2(2.525, 2.425, math.radians(15.0))


class Heard(dict):
    """The last message of each topic, by name."""

    def __init__(self, node: Node) -> None:
        self.paths: list[tuple[float, float]] = []
        kinds = {
            names.COLOUR: names.IMAGE,
            names.DEPTH: names.IMAGE,
            names.DEPTH_INFO: names.CAMERA_INFO,
            names.ODOMETRY: names.ODOMETRY_TYPE,
            names.TRUTH: names.ODOMETRY_TYPE,
            names.JOINTS: names.JOINT_STATE,
            names.TF: names.TF_TYPE,
            names.TF_STATIC: names.TF_TYPE,
            names.CLOCK: names.CLOCK_TYPE,
        }
        for topic, kind in kinds.items():
            delivery = LATCHED if topic == names.TF_STATIC else STATE
            node.subscribe(topic, kind, lambda message, _, topic=topic: self._hear(topic, message), delivery)

    def _hear(self, topic, message):
        self[topic] = message
        if topic == names.ODOMETRY:
            self.paths.append((message.pose.pose.position.x, message.twist.twist.linear.x))

    @property
    def x_m(self) -> float:
        return self[names.ODOMETRY].pose.pose.position.x

    @property
    def speed_mps(self) -> float:
        return self[names.ODOMETRY].twist.twist.linear.x


@pytest.fixture(scope="module")
def robot():
    with make_robot(load_scene("room"), start=START, knows_start=False, pose="odometry", image_px=32) as made:
        yield made


@pytest.fixture
def served(robot, other: Node) -> SimulatedRosRobot:
    # It serves in the thread of the test, because a GL context belongs to the thread that made it.
    robot.restart(START)
    return SimulatedRosRobot(robot, other, image_hz=20.0, rate=RATE)


def test_odometry_tells_how_fast_a_slow_robot_moves_whatever_is_commanded(node: Node, other: Node):
    heard = Heard(node)
    command = node.publisher(names.COMMAND, names.TWIST)
    slow = {"robot": "turtlebot3_burger", "drive": "physics", "pose": "odometry", "image_px": 16}
    with make_robot(load_scene("room"), start=START, knows_start=False, **slow) as robot:
        served = SimulatedRosRobot(robot, other, image_hz=1.0, rate=RATE)

        def command_on() -> bool:
            if command.num_subscribers:
                command.publish(node.messages.twist(0.5, 0.0))
            return names.ODOMETRY in heard and heard.x_m > 0.3

        served.serve(command_on, 20.0)
        xs_m, speeds = np.array(heard.paths).T
    assert xs_m[-1] > 0.3
    assert speeds[xs_m > 0.2] == pytest.approx(robot.limits.forward_mps, rel=0.1)
    assert robot.limits.forward_mps < 0.4


def test_everything_is_published_in_the_frames_and_units_of_ros(node: Node, served):
    heard = Heard(node)

    served.serve(lambda: len(heard) == 9 and heard.x_m is not None, 120.0)

    assert heard[names.COLOUR].encoding == "rgb8"
    assert heard[names.COLOUR].header.frame_id == heard[names.DEPTH_INFO].header.frame_id == "camera_optical_frame"
    depth_m = heard[names.DEPTH].data.view("<f4")
    assert heard[names.DEPTH].encoding == "32FC1"
    assert 0.1 < np.nanmedian(depth_m) < 10.0
    info = heard[names.DEPTH_INFO]
    assert info.k[2] == 15.5  # The middle of 32 pixels, from the centre of the first one.
    link = heard[names.TF_STATIC].transforms[0]
    assert (link.header.frame_id, link.child_frame_id) == ("base_link", "camera_optical_frame")
    assert link.transform.translation.z > 0.1
    link = heard[names.TF].transforms[0]
    assert (link.header.frame_id, link.child_frame_id) == ("odom", "base_link")
    # Odometry begins at zero wherever the robot stands; the truth does not.
    assert heard.x_m == pytest.approx(0.0, abs=1e-9)
    assert heard[names.TRUTH].pose.pose.position.x == pytest.approx(START.x_m)
    assert heard[names.TRUTH].header.frame_id == "world"
    assert len(heard[names.JOINTS].name) == len(heard[names.JOINTS].position) == 2


def test_it_follows_a_command_within_its_limits_and_brakes_without_one(node: Node, served):
    heard = Heard(node)
    command = node.publisher(names.COMMAND, names.TWIST)
    threading.Thread(target=lambda: _command_once(node, command, heard), daemon=True).start()

    done = served.serve(lambda: names.ODOMETRY in heard and heard.x_m > 0.01 and heard.speed_mps == 0.0, 30.0)

    speeds = np.array([speed for _, speed in heard.paths])
    assert 0.1 < speeds.max() <= 0.3 + 1e-9
    assert np.abs(np.diff(speeds)).max() <= 1.5 * 0.02 * 3  # A message or two may be lost.
    assert speeds[-1] == 0.0
    assert 0.01 < heard.x_m < 0.6
    assert done.contacts == 0
    assert done.simulated_s < 30.0


def _command_once(node: Node, command, heard: Heard) -> None:
    wait_until(lambda: names.ODOMETRY in heard and command.num_subscribers)
    command.publish(node.messages.twist(0.3, 0.0))


def test_an_obstacle_stops_it_and_counts_once(node: Node, served):
    heard = Heard(node)
    end = threading.Event()
    command = node.publisher(names.COMMAND, names.TWIST)

    def ram():
        wait_until(lambda: command.num_subscribers)
        while not end.wait(0.02):
            command.publish(node.messages.twist(0.5, 0.0))

    threading.Thread(target=ram, daemon=True).start()
    done = served.serve(lambda: False, 12.0)
    end.set()

    assert heard.x_m > 0.1
    assert done.contacts == 1
    assert done.images + done.skipped >= 200


@pytest.mark.parametrize(
    ("options", "said"), [({"rate": 0.0}, "--rate is 0"), ({"image_hz": 99.0}, "--image-hz is 99")]
)
def test_rates_without_meaning_are_refused(robot, node: Node, options, said):
    with pytest.raises(ConfigError, match=said):
        SimulatedRosRobot(robot, node, **options)


def test_no_image_is_stamped_before_the_beginning(node: Node, other: Node):
    stamps, late_s = [], 0.1
    node.subscribe(names.DEPTH, names.IMAGE, lambda message, _: stamps.append(seconds(message.header.stamp)), STATE)
    sensor = SensorConfig(delay_s=late_s)
    with make_robot(
        load_scene("room"), start=START, knows_start=False, pose="odometry", image_px=32, sensor=sensor
    ) as late:
        done = SimulatedRosRobot(late, other, image_hz=20.0, rate=0.5).serve(lambda: len(stamps) > 2, 20.0)
    assert done.images > 2
    assert min(stamps) >= 0.0
