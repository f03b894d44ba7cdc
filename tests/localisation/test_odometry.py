import math

import numpy as np
import pytest

from anm_mj.frames import move_pose
from anm_mj.localisation.odometry import Odometer
from anm_mj.sim.drives.kinematic_drive import KinematicDrive
from anm_mj.sim.drives.physics_drive import PhysicsDrive
from anm_mj.types import Action, Pose2, Twist
from tests.robots import clearance_of

ACTIONS = [Action.MOVE_FORWARD, Action.TURN_LEFT, Action.MOVE_FORWARD, Action.TURN_RIGHT] * 5


def test_odometry_without_slip_is_exact(compile_scene, description):
    drive = KinematicDrive(*compile_scene(), description, clearance_of())
    drive.place(Pose2(1.0, 2.0, 0.5))
    for action in ACTIONS:
        drive.act(action)
    drive.drive(Twist(0.3, 0.7), 1.3)
    drive.look_at(np.array([5.0, 0.0, 1.0]))
    for name in ("x_m", "y_m", "yaw_rad"):
        assert getattr(drive.odometry, name) == pytest.approx(getattr(drive.pose, name), abs=1e-10)


def test_wheels_on_a_floor_slip_a_little(compile_scene, description):
    drive = PhysicsDrive(*compile_scene(), description)
    for action in ACTIONS:
        drive.act(action)
    off_m = math.dist(drive.odometry.xy_m, drive.pose.xy_m)
    assert 1e-6 < off_m < 0.005
    drive.place(Pose2(0.0, 1.0, 2.0))
    assert drive.odometry == Pose2(0.0, 1.0, 2.0)


def test_noise_is_independent_of_the_reading_rate(kinematics):
    for readings in (1, 8):
        ends = []
        for seed in range(150):
            odometer = Odometer(kinematics, noise=0.02, seed=seed)
            odometer.reset(Pose2(0.0, 0.0, 0.0), np.zeros(2))
            for k in range(1, readings + 1):
                odometer.update(np.full(2, 20.0 * k / readings))
            ends.append(odometer.pose)
        spread_rad = 0.02 * math.sqrt(2 * 20.0) * 0.05 / 0.30
        assert np.std([end.yaw_rad for end in ends]) == pytest.approx(spread_rad, rel=0.2)
        assert np.mean([end.x_m for end in ends]) == pytest.approx(1.0, abs=0.003)


def test_the_same_seed_drifts_the_same_way(kinematics):
    def end(seed):
        odometer = Odometer(kinematics, noise=0.05, seed=seed)
        for k in range(20):
            odometer.update(np.array([0.3 * k, 0.2 * k]))
        return odometer.pose

    assert end(3) == end(3) != end(4)


def test_a_restart_forgets_what_was_rolled(kinematics):
    odometer = Odometer(kinematics)
    odometer.update(np.array([1.0, 2.0]))
    odometer.reset(Pose2(3.0, 4.0, 1.0), np.array([1.0, 2.0]))
    odometer.update(np.array([2.0, 3.0]))
    expected = move_pose(Pose2(3.0, 4.0, 1.0), 0.05, 0.0)
    assert (odometer.pose.x_m, odometer.pose.y_m) == pytest.approx((expected.x_m, expected.y_m), abs=1e-12)
