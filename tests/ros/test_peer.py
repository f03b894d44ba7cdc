"""An independent ROS 2 client sees both sides as they are documented, drives the robot and calls the services."""

import os
import re
import time
from pathlib import Path

import pytest

from tests.ros.processes import Peer, build_peer, running

pytestmark = pytest.mark.slow
"""They build a program in Rust, and run in real time."""

NOT_LATCHED, LATCHED = (True, False), (True, True)
ROBOT = {
    "/camera/color/image_raw": ("sensor_msgs::msg::dds_::Image_", NOT_LATCHED, "camera_optical_frame", "rgb8 256x256"),
    "/camera/color/camera_info": (
        "sensor_msgs::msg::dds_::CameraInfo_",
        NOT_LATCHED,
        "camera_optical_frame",
        "plumb_bob 256x256 127.500",
    ),
    "/camera/depth/image_raw": ("sensor_msgs::msg::dds_::Image_", NOT_LATCHED, "camera_optical_frame", "32FC1 256x256"),
    "/camera/depth/camera_info": (
        "sensor_msgs::msg::dds_::CameraInfo_",
        NOT_LATCHED,
        "camera_optical_frame",
        "plumb_bob 256x256 127.500",
    ),
    "/odom": ("nav_msgs::msg::dds_::Odometry_", NOT_LATCHED, "odom", r"base_link \S+ \S+ \S+"),
    "/ground_truth/odom": ("nav_msgs::msg::dds_::Odometry_", NOT_LATCHED, "world", r"base_link \S+ \S+ \S+"),
    "/tf": ("tf2_msgs::msg::dds_::TFMessage_", NOT_LATCHED, "odom", "odom>base_link"),
    "/tf_static": ("tf2_msgs::msg::dds_::TFMessage_", LATCHED, "base_link", "base_link>camera_optical_frame"),
    "/joint_states": ("sensor_msgs::msg::dds_::JointState_", NOT_LATCHED, "", "wheel_left wheel_right"),
    "/clock": ("rosgraph_msgs::msg::dds_::Clock_", NOT_LATCHED, "", r"\d+\.\d+"),
}
EXPLORER = {
    "/map": ("nav_msgs::msg::dds_::OccupancyGrid_", LATCHED, "map", r"0\.0\d+ [1-9]\d+"),
    "/plan": ("nav_msgs::msg::dds_::Path_", LATCHED, "map", r"\d+"),
    "/explore/markers": (
        "visualization_msgs::msg::dds_::MarkerArray_",
        LATCHED,
        "map",
        "graph regions candidates target",
    ),
    "/explore/surface": ("sensor_msgs::msg::dds_::PointCloud2_", LATCHED, "map", r"x,y,z,rgb [1-9]\d+"),
    "/pose": ("geometry_msgs::msg::dds_::PoseWithCovarianceStamped_", NOT_LATCHED, "map", r"\S+ \S+"),
    "/diagnostics": (
        "diagnostic_msgs::msg::dds_::DiagnosticArray_",
        NOT_LATCHED,
        "map",
        r"anm_mj: explore [01] step,plan,command",
    ),
    "/tf": ("tf2_msgs::msg::dds_::TFMessage_", NOT_LATCHED, "(map|odom)", "map>odom|odom>base_link"),
    "/cmd_vel": ("geometry_msgs::msg::dds_::Twist_", NOT_LATCHED, "", r"-?\d\.\d+ -?\d\.\d+"),
}


@pytest.fixture(scope="module")
def peer() -> Peer:
    # RustDDS finds others by multicast alone, which a network of this machine alone has not.
    return Peer(build_peer(), 101 + os.getpid() % 50)


@pytest.fixture(scope="module")
def robot(peer: Peer, tmp_path_factory):
    out = tmp_path_factory.mktemp("robot") / "simulate.log"
    with running("simulate", "room", "--ros", out=out, **peer.environment):
        _wait_for(out, "the robot listens")
        yield out


def test_the_robot_is_what_its_page_says_and_follows_both_kinds_of_velocities(robot: Path, peer: Peer):
    _require(ROBOT, peer("offers", 4), peer("hear", 20, ""))

    for kind, forward in (("plain", 0.2), ("stamped", -0.2)):
        driving = peer.begin("drive", 25, "/cmd_vel", forward, 0.0, kind)
        heard = {one["topic"]: one for one in peer("hear", 16, "")}
        peer.end(driving)
        for topic in ("/odom", "/ground_truth/odom"):
            first, last = ([float(word) for word in heard[topic][when].split()[1:]] for when in ("first", "last"))
            assert abs(last[0] - first[0]) > 0.02, (kind, heard[topic])


def test_the_explorer_is_what_its_page_says_and_obeys(robot: Path, peer: Peer, tmp_path: Path):
    out, run = tmp_path / "drive.log", tmp_path / "run"
    quick = ("--preset", "quick", "--pose", "slam", "--wait", "--out", run)
    with running("drive", *quick, out=out, **peer.environment) as explorer:
        _wait_for(out, "Wrote|explores|waits", run / "manifest.json")
        assert peer("call", 20, "/explore/start") == [{"success": True, "message": "goes on"}]
        listening = peer.begin("hear", 45, "")
        offered = peer("offers", 4)
        _require(EXPLORER, offered, peer.end(listening))

        assert peer("call", 20, "/explore/pause") == [{"success": True, "message": "pauses after this step"}]
        steps = run / "steps.jsonl"
        time.sleep(3.0)
        paused_at = steps.read_text().count("\n")
        assert peer("call", 20, "/explore/save")[0]["success"]
        time.sleep(3.0)
        assert steps.read_text().count("\n") == paused_at
        assert (run / "map.safetensors").is_file()
        assert peer("call", 20, "/explore/home")[0]["success"]
        peer("ask", 6, "/explore/start")
        peer("say", 5, "/explore/command", "stop")
        assert explorer.wait(60.0) == 0
    assert "INTERRUPTED" in out.read_text()
    assert "/explore/start: its caller's ROS 2 does not run on Cyclone DDS and gets no reply" in out.read_text()


def _require(wanted: dict, offered: list[dict], heard: list[dict]) -> None:
    """Every topic has type, QoS, frame and content, and no message that its definition forbids."""
    offers, said = ({one["topic"]: one for one in lines} for lines in (offered, heard))
    for topic, (kind, qos, frame, content) in wanted.items():
        assert (offers[topic]["type"], (offers[topic]["reliable"], offers[topic]["latched"])) == (kind, qos), topic
        one = said[topic]
        assert one["count"] > 0, topic
        assert one["wrong"] == "", one
        assert re.fullmatch(frame, one["frame"]), one
        assert re.match(content, one["last"]), one


def _wait_for(out: Path, said: str, made: Path | None = None) -> None:
    end = time.monotonic() + 60.0
    while not re.search(said, out.read_text()) and not (made and made.is_file()):
        assert time.monotonic() < end, out.read_text()
        time.sleep(0.2)
