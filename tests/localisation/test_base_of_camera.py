"""Where the base is whose camera was found."""

from dataclasses import replace

import numpy as np

from anm_mj.localisation.localiser import BaseOfCamera
from anm_mj.sensing.sensor_monitor import SensorMonitor
from anm_mj.types import Pose2
from tests.mapping.ray_room import Room


def test_the_mount_is_that_of_the_first_frame_whose_pose_was_said() -> None:
    monitor, base = SensorMonitor(), BaseOfCamera(None)
    true = Room().observe(1.0, 1.5, 0.4)
    nowhere = replace(true, pose=Pose2(np.nan, np.nan, np.nan), T_world_camera=np.full((4, 4), np.nan))
    for seen in (nowhere, nowhere):
        seen = monitor.check(seen)
        assert base.pose(seen, seen.T_world_camera) == Pose2(0.0, 0.0, 0.0)
    for seen in (true, Room().observe(1.2, 1.4, 0.5)):
        found = base.pose(monitor.check(seen), seen.T_world_camera)
        np.testing.assert_allclose((*found.xy_m, found.yaw_rad), (*seen.pose.xy_m, seen.pose.yaw_rad), atol=1e-9)
