"""What a live robot publishes of its run."""

from contextlib import contextmanager
from unittest.mock import Mock

import pytest

from anm_mj.loop_state import LoopState
from anm_mj.ros import drive
from anm_mj.ros.connect import Connection
from anm_mj.ros.drive_config import DriveConfig
from anm_mj.ros.health import Health
from anm_mj.ros.live_robot import LiveRobot
from anm_mj.ros.node import STATE, Node
from anm_mj.ros.poses import Poses
from anm_mj.types import Pose2
from tests.ros.conftest import wait_until


@pytest.mark.parametrize("is_first", [False, True])
def test_diagnostics_say_what_is_wrong_where_poses_come_no_more(
    node: Node, other: Node, monkeypatch: pytest.MonkeyPatch, is_first: bool
):
    health, said = Health(0.2), []
    poses = Poses(health, "")
    poses.source = "the odometry on /odom"
    health.expect(poses.source)

    @contextmanager
    def connect(*_):
        yield Connection(node, Mock(spec=LiveRobot), poses, health)

    monkeypatch.setattr(drive, "connect", connect)
    other.subscribe(
        "/diagnostics",
        "diagnostic_msgs/msg/DiagnosticArray",
        lambda message, _: said.append(message.status[0].message),
        STATE,
    )
    config = DriveConfig("live", pose="odometry", policy="frontier")
    followers, state = drive._Followers(), LoopState()
    with drive._parts(config, followers=followers, state=state, waits=False, is_over=lambda: False):
        if not is_first:
            poses.hear_odometry(node.messages.odometry(1.0, "odom", "base_link", Pose2(0.0, 0.0, 0.0)))
        wait_until(lambda: "nothing was heard of the odometry on /odom for 0.2 s" in said)
