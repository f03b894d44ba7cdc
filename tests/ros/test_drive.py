"""A whole run on a live robot: run folder, topics, commands, and a run that goes on."""

import json

import pytest

from anm_mj.config import make_config
from anm_mj.io.read_run import read_run
from anm_mj.ros import names
from anm_mj.ros.control import TOPIC
from anm_mj.ros.drive import drive, go_on
from anm_mj.ros.drive_config import DriveConfig
from anm_mj.ros.node import LATCHED, STATE, Node
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
