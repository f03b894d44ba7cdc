"""What is published arrives, with the names, types and QoS of ROS 2; wrong settings are told in a sentence."""

import struct
import time

import numpy as np
import pytest

from anm_mj.errors import ConfigError
from anm_mj.ros.names import IMAGE, ODOMETRY_TYPE, TWIST, TWIST_STAMPED
from anm_mj.ros.network import domain_id, network_config
from anm_mj.ros.node import LATCHED, STATE, Node
from anm_mj.ros.services import register_type, serve_trigger
from anm_mj.types import Pose2
from tests.ros.conftest import wait_until


def test_an_image_arrives_as_it_was_sent(node: Node, other: Node):
    depth_m = np.random.default_rng(0).random((48, 64)).astype(np.float32)
    depth_m[0, :2] = np.nan, np.inf
    heard = []
    other.subscribe("camera/depth", IMAGE, lambda message, _: heard.append(message))
    publisher = node.publisher("/camera/depth", IMAGE, STATE)
    wait_until(lambda: publisher.num_subscribers)

    publisher.publish(node.messages.image(12.5, "camera", depth_m))

    wait_until(lambda: heard)
    assert (heard[0].header.stamp.sec, heard[0].header.stamp.nanosec) == (12, 500_000_000)
    assert (heard[0].encoding, heard[0].step, heard[0].height) == ("32FC1", 256, 48)
    np.testing.assert_array_equal(heard[0].data.view("<f4").reshape(48, 64), depth_m)


def test_who_comes_late_hears_the_last_latched_message(node: Node, other: Node):
    publisher = node.publisher("pose", ODOMETRY_TYPE, LATCHED)
    for x_m in (1.0, 2.0):
        publisher.publish(node.messages.odometry(0.0, "map", "base_link", Pose2(x_m, 0.0, 0.0)))
    heard = []

    other.subscribe("pose", ODOMETRY_TYPE, lambda message, _: heard.append(message.pose.pose.position.x), LATCHED)

    wait_until(lambda: heard)
    assert heard == [2.0]


def test_one_topic_is_heard_in_both_of_its_types(node: Node, other: Node):
    heard = []
    other.subscribe("cmd_vel", TWIST, lambda message, _: heard.append(message.linear.x))
    other.subscribe("cmd_vel", TWIST_STAMPED, lambda message, _: heard.append(message.twist.linear.x))
    plain, stamped = node.publisher("cmd_vel", TWIST), node.publisher("cmd_vel", TWIST_STAMPED)
    wait_until(lambda: plain.num_subscribers and stamped.num_subscribers)

    plain.publish(node.messages.twist(1.0, 0.0))
    header, twist = node.messages.header(0.0, ""), node.messages.twist(2.0, 0.0)
    stamped.publish(node.messages.make(TWIST_STAMPED, header=header, twist=twist))

    wait_until(lambda: len(heard) == 2)
    assert sorted(heard) == [1.0, 2.0]


def test_topics_are_found_by_type_below_their_namespace(other: Node):
    with Node("robot1") as robot:
        robot.publisher("odom", ODOMETRY_TYPE)
        wait_until(lambda: other.published().get("/robot1/odom") == ODOMETRY_TYPE)


def test_a_message_that_cannot_be_taken_in_is_told_and_the_next_one_is_heard(node: Node):
    told, heard = [], []

    def take(message, _):
        heard.append(message.linear.x)
        if len(heard) == 1:
            raise ValueError("too fast")

    with Node(on_bad=lambda topic, what: told.append((topic, what))) as careful:
        careful.subscribe("cmd_vel", TWIST, take, STATE)
        publisher = node.publisher("cmd_vel", TWIST)
        wait_until(lambda: publisher.num_subscribers)
        for speed in (9.0, 0.5):
            publisher.publish(node.messages.twist(speed, 0.0))
        wait_until(lambda: len(heard) == 2)

    assert told == [("/cmd_vel", "too fast")]


def test_a_service_obeys_callers_that_it_cannot_answer(node: Node, other: Node, caplog):
    """Those whose ROS 2 does not run on Cyclone DDS, and who send only what the request itself holds."""
    calls, replies = [], []
    serve_trigger(node, "start", lambda: (calls.append(1) is None, "goes on"))
    reply = "std_srvs/srv/Trigger_Response"
    register_type(other.messages.store, reply, "uint64 client\nint64 number\nbool success\nstring message\n")
    register_type(other.messages.store, "std_srvs/srv/Trigger_Request", "uint8 unused\n")
    other.raw_subscribe("rr/startReply", reply, lambda message, _: replies.append(message))
    requests = other.raw_publisher("rq/startRequest", "std_srvs/srv/Trigger_Request")
    wait_until(lambda: requests.num_subscribers)
    time.sleep(0.2)  # The way back is found within it.

    head = b"\0\1\0\0"
    for request in (head + bytes(1), head + struct.pack("<QqB", 7, 3, 0)):
        requests.publish_cdr(request)

    wait_until(lambda: replies)
    assert [(one.client, one.number, one.success, one.message) for one in replies] == [(7, 3, True, "goes on")]
    assert len(calls) == 2
    assert "gets no reply" in caplog.text


@pytest.mark.parametrize(("text", "number"), [("", 0), ("0", 0), (" 42 ", 42), ("232", 232)])
def test_the_domain_is_that_of_the_environment(text: str, number: int):
    assert domain_id({"ROS_DOMAIN_ID": text}) == number


@pytest.mark.parametrize("text", ["-1", "233", "robot", "1.5"])
def test_a_wrong_domain_is_told(text: str):
    with pytest.raises(ConfigError, match=f"ROS_DOMAIN_ID is '{text}'; set a whole number from 0 to 232"):
        domain_id({"ROS_DOMAIN_ID": text})


def test_the_network_is_this_machine_alone_where_the_environment_says_so():
    for environment in ({"ROS_LOCALHOST_ONLY": "1"}, {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}):
        assert "127.0.0.1" in str(network_config(environment))
        assert network_config({**environment, "CYCLONEDDS_URI": "file:///etc/dds.xml"}) is None
    assert "127.0.0.1" not in str(network_config({}))
    with pytest.raises(ConfigError, match="ROS_AUTOMATIC_DISCOVERY_RANGE is 'OFF'"):
        network_config({"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"})


@pytest.mark.parametrize(
    "name", ["1st", "a//b", "a b", "a/", "", "kamerä", "camera_on_the_left/depth_registered_to_colour-1"]
)
def test_names_that_ros_does_not_have_are_refused(node: Node, name: str):
    with pytest.raises(ConfigError, match="is no name of ROS 2"):
        node.name(name)
