"""A whole run on a live robot: run folder, topics, commands, and a run that goes on."""

import json
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from anm_mj.config import make_config
from anm_mj.errors import RobotError
from anm_mj.io.read_run import read_run
from anm_mj.ros import names
from anm_mj.ros.connect import connect
from anm_mj.ros.control import TOPIC
from anm_mj.ros.drive import drive, go_on
from anm_mj.ros.drive_config import DriveConfig, RosConfig
from anm_mj.ros.navigation import ABORTED, CANCELED, SUCCEEDED
from anm_mj.ros.node import LATCHED, STATE, Node
from tests.ros.conftest import wait_until
from tests.ros.fake_navigator import FakeNavigator
from tests.ros.fake_ros_robot import FakeRosRobot

pytestmark = pytest.mark.slow
"""They run in real time, which a machine that is busy with other tests does not give them."""

QUICK = [
    "mapping.schedule.first_iterations=5",
    "checkpoint.every_steps=2",
    "ros.wait_s=8.0",
    "policy.bootstrap_turns=0",
]


class Heard(dict):
    """The last message of each topic of the explorer."""

    def __init__(self, node: Node) -> None:
        self.commands: set[str] = set()
        for topic, kind in {
            "map": "nav_msgs/msg/OccupancyGrid",
            "plan": "nav_msgs/msg/Path",
            "explore/markers": "visualization_msgs/msg/MarkerArray",
        }.items():
            node.subscribe(topic, kind, lambda message, _, topic=topic: self.__setitem__(topic, message), LATCHED)
        node.subscribe("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", self._diagnostics, STATE)
        node.subscribe(names.TF, names.TF_TYPE, self._frames, STATE)

    def _diagnostics(self, message, _):
        self["diagnostics"] = message.status[0]
        self.commands |= {pair.value for pair in message.status[0].values if pair.key == "command"}

    def _frames(self, message, _):
        self["tf"] = message.transforms[0]


class StopAfter:
    """Sends the command to stop after so many steps."""

    def __init__(self, node: Node, steps: int) -> None:
        self.to, self.node, self.steps = node.publisher(TOPIC, "std_msgs/msg/String"), node, steps

    def on_event(self, event) -> None:
        if getattr(event, "step", 0) >= self.steps:
            self.to.publish(self.node.messages.make("std_msgs/msg/String", data="stop"))


def test_a_run_is_stopped_by_a_command_and_goes_on(node: Node, other: Node, tmp_path):
    heard = Heard(node)
    config = make_config("quick", QUICK, kind=DriveConfig, scene="live", pose="odometry", steps=9)
    with FakeRosRobot(other) as fake:
        folder, metrics = drive(config, out=tmp_path / "run", observers=[StopAfter(node, 3)])
        stopped_at = metrics.steps
        assert metrics.stop_reason == "INTERRUPTED"
        assert 3 <= stopped_at < 9

        folder, metrics = go_on(tmp_path / "run")

    assert (metrics.steps, metrics.stop_reason, metrics.collisions) == (9, "BUDGET", 0)
    assert metrics.completion_ratio is None
    assert not fake.touched
    run = read_run(folder.path)
    assert len(run.frames) == 10
    assert folder.mesh.is_file()
    assert json.loads(folder.config.read_text())["ros"]["radius_m"] == 0.18
    assert heard["map"].info.resolution > 0.0
    assert heard["map"].header.frame_id == heard["plan"].header.frame_id == "map"
    assert {marker.ns for marker in heard["explore/markers"].markers} == {"graph", "regions", "candidates", "target"}
    assert (heard["tf"].header.frame_id, heard["tf"].child_frame_id) == ("map", "odom")
    assert heard["diagnostics"].name == "anm_mj: explore"
    assert "stop: ends after this step" in heard.commands


@pytest.mark.parametrize("way", ["nav2", "goal_pose"])
def test_another_navigation_drives_the_robot_to_goals(way: str, other: Node, tmp_path):
    settings = [*QUICK, f"ros.drive={way}"]
    config = make_config("quick", settings, kind=DriveConfig, scene="live", pose="odometry", steps=50)
    with FakeRosRobot(other) as fake, FakeNavigator(other, fake, action=way == "nav2") as navigator:
        start = fake.pose
        folder, metrics = drive(config, out=tmp_path / "run")
        assert metrics.steps == 50
        wait_until(lambda: fake.speed == 0.0)

    assert 1 <= len(navigator.goals) < 50
    assert metrics.path_m > 0.3
    assert len(read_run(folder.path).frames) == 51
    assert (fake.pose.x_m, fake.pose.y_m) != (start.x_m, start.y_m)
    assert not fake.touched
    if way == "nav2":
        # The last goal is taken back at the end of the run, and others were reached or replaced.
        assert navigator.cancelled >= 1
        assert set(navigator.statuses) <= {SUCCEEDED, CANCELED, ABORTED}
    else:
        assert navigator.goals[-1] != navigator.goals[0]


@pytest.mark.parametrize("reason", ["pause", "images"])
def test_the_goal_is_taken_back_where_the_run_waits(reason: str, node: Node, other: Node, tmp_path):
    settings = [*QUICK, "ros.drive=nav2"]
    config = make_config("quick", settings, kind=DriveConfig, scene="live", pose="odometry", steps=30)
    to = node.publisher(TOPIC, "std_msgs/msg/String")

    def say(word: str) -> None:
        to.publish(node.messages.make("std_msgs/msg/String", data=word))

    with FakeRosRobot(other) as fake, FakeNavigator(other, fake, action=True) as navigator:
        with ThreadPoolExecutor() as pool:
            run = pool.submit(drive, config, out=tmp_path / "run")
            wait_until(lambda: abs(fake.speed) > 0.1, 30.0)
            fake.broken.add(reason)
            if reason == "pause":
                say("pause")
            try:
                wait_until(lambda: navigator.cancelled == 1)
                time.sleep(0.6)
                assert fake.speed == 0.0
            finally:
                fake.broken.clear()
                say("start")
        assert run.result()[1].steps == 30


def test_a_navigation_that_is_missing_is_told(other: Node):
    config = DriveConfig("live", pose="odometry", ros=RosConfig(wait_s=3.0, drive="nav2"))
    said = "nobody offers the action /navigate_to_pose of nav2_msgs/NavigateToPose"
    with FakeRosRobot(other), pytest.raises(RobotError, match=said), connect(config, lambda: False):
        pass
