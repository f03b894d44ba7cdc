"""Where a live robot is, by the frames on tf alone."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from anm_mj.errors import RobotError
from anm_mj.events import Observed
from anm_mj.frames import pose_matrix
from anm_mj.io.ros_messages import RosMessages
from anm_mj.ros.commander import STILL, Commander
from anm_mj.ros.connect import Connection
from anm_mj.ros.drive_config import RosConfig
from anm_mj.ros.health import Health
from anm_mj.ros.map_publisher import MapPublisher
from anm_mj.ros.node import Node
from anm_mj.ros.poses import TREE, Poses
from anm_mj.types import Pose2, Twist
from tests.box_room import observe
from tests.ros.conftest import wait_until


def test_frames_above_the_odometry_are_no_news_of_the_robot():
    make, poses = RosMessages(), Poses(Health(0.2), "")
    poses.source = TREE
    T_base_camera = np.eye(4)
    poses.hear_frames(make.transforms(0.0, [("base_link", "camera", T_base_camera)]), 1, static=True)
    poses.hear_frames(
        make.transforms(5.0, [make.base_link("odom", "base_link", Pose2(1.0, 0.0, 0.0))]), 1, static=False
    )
    assert poses.latest_s == 5.0

    # The explorer says so itself, with the stamp of the last pose.
    poses.hear_frames(make.transforms(5.0, [make.base_link("map", "odom", Pose2(9.0, 0.0, 0.0))]), 2, static=False)
    poses.hear_frames(
        make.transforms(5.1, [make.base_link("odom", "base_link", Pose2(1.5, 0.0, 0.0))]), 1, static=False
    )

    assert poses.latest_s == pytest.approx(5.1)
    assert poses.base(5.1) == Pose2(1.5, 0.0, 0.0)
    assert poses.odometry_frame == "odom"


def test_what_was_known_before_the_clock_was_set_back_is_forgotten():
    make, poses = RosMessages(), Poses(Health(0.2), "")
    poses.source = TREE
    before, after = (make.base_link("odom", "base_link", Pose2(x_m, 0.0, 0.0)) for x_m in (0.0, 5.0))
    for link, steps in ((before, 21), (after, 11)):
        for step in range(steps):
            poses.hear_frames(make.transforms(10.0 + 0.1 * step, [link]), 1, static=False)

    found = poses.base(10.45)
    assert found is not None
    assert found.x_m == 5.0
    assert poses.latest_s == pytest.approx(11.0)
    # Messages of two publishers come out of order by less.
    poses.hear_frames(make.transforms(10.8, [after]), 1, static=False)
    assert poses.base(10.45) == found


def test_a_base_in_two_frames_is_told_and_the_robot_is_stopped():
    make, health = RosMessages(), Health(0.2)
    poses, node = Poses(health, ""), Mock(spec=Node, messages=make)
    for parent in ("odom", "map"):
        poses.hear_frames(
            make.transforms(5.0, [make.base_link(parent, "base_link", Pose2(0.0, 0.0, 0.0))]), 1, static=False
        )
    poses.source = TREE
    said = "The frames on tf are no tree: the frame 'base_link' stands in several: 'odom', 'map'; stop one of the"
    with pytest.raises(RobotError, match=said):
        _ = poses.odometry_frame
    with pytest.raises(RobotError, match=said):
        _ = poses.latest_s

    commander = Commander(node, replace(RosConfig(), stamped=True), health)
    sent = node.publisher.return_value.publish
    try:
        commander.stamp_s = lambda: poses.latest_s
        commander.drive(Twist(0.3, 0.0))
        wait_until(lambda: str(health.present()).startswith("The frames on tf are no tree"))
        wait_until(lambda: sent.call_count > 5)
    finally:
        commander.close()
    assert commander._now == STILL
    assert sent.call_args.args[0].twist.linear.x == 0.0


def test_the_map_meets_the_robot_where_its_odometry_stands_in_a_frame_of_the_world():
    make, health = RosMessages(), Health(0.2)
    poses, node = Poses(health, ""), Mock(spec=Node, messages=make)
    poses.source = "the odometry on /robot1/odom"
    world, here = Pose2(3.0, -2.0, 0.5), Pose2(1.0, 0.4, 0.2)
    publisher = MapPublisher(Mock(Connection, node=node, poses=poses, health=health))
    sent = node.publisher.return_value.publish
    poses.hear_odometry(make.odometry(5.0, "robot1/odom", "robot1/base", here))

    def told():
        sent.reset_mock()
        seen = replace(observe(0, Pose2(1.1, 0.4, 0.2)), time_s=5.0)
        publisher.on_event(Mock(Observed, observation=seen, estimate=None))
        publisher.tell(force=True)
        links = [m.args[0].transforms[0] for m in sent.call_args_list if hasattr(m.args[0], "transforms")]
        place = links[-1].transform.translation
        return links[-1].child_frame_id, (place.x, place.y, place.z)

    # Nobody says more of frames: the odometry's own.
    frame, place = told()
    assert frame == "robot1/odom"
    assert place == pytest.approx((0.1, 0.0, 0.0), abs=1e-9)

    links = [make.base_link("world", "robot1/odom", world)]
    poses.hear_frames(make.transforms(0.0, links), 1, static=True)
    poses.hear_frames(make.transforms(5.0, [make.base_link("robot1/odom", "robot1/base", here)]), 1, static=False)
    frame, place = told()
    assert frame == "world"
    T_map_world = pose_matrix(Pose2(1.1, 0.4, 0.2)) @ np.linalg.inv(pose_matrix(world) @ pose_matrix(here))
    assert place == pytest.approx(tuple(T_map_world[:3, 3]), abs=1e-9)
