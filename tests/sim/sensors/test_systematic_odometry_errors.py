import math

import pytest

from anm_mj.frames import move_pose
from anm_mj.sim.sensors.noisy_odometry import NoisyOdometry
from anm_mj.sim.sensors.sensor_config import SensorConfig
from anm_mj.types import Pose2

START = Pose2(1.0, 2.0, 0.5)


def read_along(config, moves):
    odometry, pose = NoisyOdometry(config, 0), START
    believed = odometry.read(pose)
    for forward_m, turn_rad in moves:
        pose = move_pose(pose, forward_m, turn_rad)
        believed = odometry.read(pose)
    return believed


def test_a_radius_taken_too_large_scales_distances_and_turns():
    moves = [(0.5, 0.0), (0.0, 0.4), (0.3, 0.2)]

    believed = read_along(SensorConfig(odometry_radius_error=0.02), moves)

    expected = START
    for forward_m, turn_rad in moves:
        expected = move_pose(expected, 1.02 * forward_m, 1.02 * turn_rad)
    # The second move is a chord of the same length, not an arc.
    assert believed.xy_m == pytest.approx(expected.xy_m, abs=1e-4)
    assert believed.yaw_rad == pytest.approx(expected.yaw_rad)


def test_a_yaw_bias_bends_the_way_back_as_it_bent_it():
    there_and_back = [(0.05, 0.0)] * 40 + [(-0.05, 0.0)] * 40
    believed = read_along(SensorConfig(odometry_yaw_bias_deg_per_m=10.0), there_and_back)
    assert (believed.x_m, believed.y_m, believed.yaw_rad) == pytest.approx((START.x_m, START.y_m, START.yaw_rad))


def test_a_yaw_bias_bends_the_way_by_its_length():
    bias = math.radians(1.0)

    believed = read_along(SensorConfig(odometry_yaw_bias_deg_per_m=1.0), [(0.05, 0.0)] * 40)

    expected = move_pose(START, 2.0, 2.0 * bias)
    assert believed.yaw_rad == pytest.approx(START.yaw_rad + 2.0 * bias)
    assert believed.xy_m == pytest.approx(expected.xy_m, abs=1e-5)
    assert read_along(SensorConfig(odometry_yaw_bias_deg_per_m=1.0), [(0.0, 0.1)] * 9).yaw_rad == pytest.approx(1.4)


def test_systematic_errors_scale_with_the_noise():
    doubled = read_along(SensorConfig(odometry_radius_error=0.02, noise_scale=2.0), [(1.0, 0.0)])
    assert doubled == read_along(SensorConfig(odometry_radius_error=0.04), [(1.0, 0.0)])
    assert read_along(SensorConfig(odometry_radius_error=0.02, noise_scale=0.0), [(1.0, 0.0)]) == move_pose(
        START, 1.0, 0.0
    )
