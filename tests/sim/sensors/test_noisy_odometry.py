import math

import numpy as np
import pytest

from anm_mj.frames import move_pose
from anm_mj.sim.sensors.noisy_odometry import NoisyOdometry
from anm_mj.sim.sensors.sensor_config import SensorConfig
from anm_mj.types import Pose2

START = Pose2(1.0, 2.0, 0.5)


def ends(alpha, moves, num=400):
    found, pose = [], START
    for seed in range(num):
        odometry, pose = NoisyOdometry(SensorConfig(odometry_alpha=alpha), seed), START
        believed = odometry.read(pose)
        for forward_m, turn_rad in moves:
            pose = move_pose(pose, forward_m, turn_rad)
            believed = odometry.read(pose)
        found.append((believed.x_m, believed.y_m, believed.yaw_rad))
    return np.array(found), pose


def test_without_noise_it_is_believed():
    found, pose = ends((0.0, 0.0, 0.0, 0.0), [(0.065, 0.0), (0.0, 0.2)], num=1)
    assert tuple(found[0]) == (pose.x_m, pose.y_m, pose.yaw_rad)


def test_translation_spreads_along_the_path():
    found, pose = ends((0.0, 0.0, 0.01, 0.0), [(1.0, 0.0)])
    along = (found[:, :2] - pose.xy_m) @ [math.cos(0.5), math.sin(0.5)]
    assert along.std() == pytest.approx(0.1, rel=0.15)


@pytest.mark.parametrize("parts", [1, 10])
def test_the_noise_is_the_same_however_often_it_is_read(parts):
    moves = [(0.065 / parts, 0.0)] * (20 * parts)
    found, pose = ends((0.0, 0.0, 0.01, 0.0), moves, num=300)
    along = (found[:, :2] - pose.xy_m) @ [math.cos(0.5), math.sin(0.5)]
    assert along.std() == pytest.approx(0.1 * 0.065 * math.sqrt(20), rel=0.15)


def test_rotation_spreads_with_rotation():
    found, pose = ends((0.04, 0.0, 0.0, 0.0), [(0.0, 0.5)])
    assert (found[:, 2] - pose.yaw_rad).std() == pytest.approx(0.1, rel=0.15)
    assert np.allclose(found[:, :2], pose.xy_m)


@pytest.mark.parametrize("aside_rad", np.linspace(-math.pi, math.pi, 7))
def test_a_turn_on_the_spot_that_creeps_a_little_is_no_turn_there_and_back(aside_rad):
    """By encoders that err, or wheels that slip, a turn moves the robot by millimetres, in any direction."""
    crept = Pose2(START.x_m + 0.002 * math.cos(aside_rad), START.y_m + 0.002 * math.sin(aside_rad), 0.5 + 0.1745)
    found = []
    for seed in range(200):
        odometry = NoisyOdometry(SensorConfig(odometry_alpha=(0.01, 0.01, 0.01, 0.01)), seed)
        odometry.read(START)
        found.append(odometry.read(crept).yaw_rad - crept.yaw_rad)
    assert np.std(found) == pytest.approx(0.1 * 0.1745, rel=0.15)
    exact = NoisyOdometry(SensorConfig(odometry_radius_error=1e-9), 0)
    exact.read(START)
    told = exact.read(crept)
    assert (told.x_m, told.y_m, told.yaw_rad) == pytest.approx((crept.x_m, crept.y_m, crept.yaw_rad), abs=1e-6)


def test_backing_up_is_no_half_turn():
    found, _ = ends((0.04, 0.0, 0.0, 0.0), [(-0.5, 0.0)])
    assert found[:, 2].std() < 1e-9


def test_reading_twice_adds_nothing():
    odometry = NoisyOdometry(SensorConfig(odometry_alpha=(0.1, 0.1, 0.1, 0.1)), 0)
    odometry.read(START)
    moved = move_pose(START, 0.065, 0.1)
    assert odometry.read(moved) == odometry.read(moved)


def test_errors_add_up_over_a_run():
    short, _ = ends((0.05, 0.01, 0.01, 0.01), [(0.065, 0.0), (0.0, 0.17)] * 5, num=100)
    long, _ = ends((0.05, 0.01, 0.01, 0.01), [(0.065, 0.0), (0.0, 0.17)] * 40, num=100)
    assert long.std(axis=0)[:2].sum() > 2 * short.std(axis=0)[:2].sum()
