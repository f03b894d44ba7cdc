"""Where a live robot is, by the frames on tf alone."""

import numpy as np
import pytest

from anm_mj.io.ros_messages import RosMessages
from anm_mj.ros.health import Health
from anm_mj.ros.poses import TREE, Poses
from anm_mj.types import Pose2


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
