"""Wheels that spin for a moment make single readings worthless."""

import math

import numpy as np
import pytest

from anm_mj.errors import RobotError
from anm_mj.frames import move_pose, relative_pose
from anm_mj.sim.sensors.noisy_odometry import NoisyOdometry
from anm_mj.sim.sensors.sensor_config import SensorConfig
from anm_mj.types import FORWARD_STEP_M, Pose2

ALPHA = (0.01, 0.01, 0.01, 0.01)


def motions(config: SensorConfig, *, num: int, forward_m: float = FORWARD_STEP_M) -> np.ndarray:
    """What is read of ``num`` motions straight ahead: ahead [m], to the left [m], turned [rad]."""
    odometry, pose = NoisyOdometry(config, 3), Pose2(1.0, 2.0, 0.5)
    before, found = odometry.read(pose), []
    for _ in range(num):
        pose = move_pose(pose, forward_m, 0.0)
        now = odometry.read(pose)
        moved = relative_pose(before, now)
        found.append((moved.x_m, moved.y_m, moved.yaw_rad))
        before = now
    return np.array(found)


@pytest.mark.parametrize("parts", [1, 5])
def test_a_share_of_the_actions_is_read_wrong_by_far(parts):
    """However often odometry is read meanwhile."""
    config = SensorConfig(odometry_slip_share=0.1, odometry_slip_m=0.08, odometry_slip_deg=20.0)
    read = motions(config, num=2000 * parts, forward_m=FORWARD_STEP_M / parts)
    off = read - [FORWARD_STEP_M / parts, 0.0, 0.0]
    slipped = np.abs(off).max(axis=1) > 1e-9
    assert np.count_nonzero(slipped) == pytest.approx(200, abs=50)
    assert np.abs(off[slipped, 0]).max() == pytest.approx(0.08, rel=0.05)
    assert np.abs(off[slipped, 2]).max() == pytest.approx(math.radians(20.0), rel=0.05)
    assert np.abs(off[slipped].mean(axis=0)).max() < 0.03


def test_slips_leave_the_other_noise_alone():
    usual = motions(SensorConfig(odometry_alpha=ALPHA), num=300)
    slipped = motions(SensorConfig(odometry_alpha=ALPHA, odometry_slip_share=0.1), num=300)
    same = np.isclose(usual, slipped, atol=1e-12).all(axis=1)
    assert 0.8 < same.mean() < 0.97


def test_sizes_of_slips_say_nothing_of_wheels_that_never_slip():
    assert SensorConfig(odometry_slip_deg=10.0).without_effect == ("odometry_slip_deg",)
    assert SensorConfig(odometry_slip_share=0.1, odometry_slip_deg=10.0).without_effect == ()
    with pytest.raises(RobotError, match="odometry_slip_share"):
        SensorConfig(odometry_slip_share=1.5)
    assert SensorConfig(odometry_slip_share=0.6, noise_scale=2.0).scaled().odometry_slip_share == 1.0
