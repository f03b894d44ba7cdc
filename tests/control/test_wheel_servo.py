import math

import mink
import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anm_mj.control.wheel_servo import BaseServo, NoSlip
from anm_mj.frames import move_pose
from anm_mj.types import Pose2
from tests.robots import ROBOT_XML

_PERIOD_S = 0.02
_MAX_RADPS = 12.0


@pytest.fixture(scope="module")
def servo(description, kinematics) -> BaseServo:
    return BaseServo(description, kinematics, period_s=_PERIOD_S, max_speeds=(_MAX_RADPS, _MAX_RADPS))


@given(left=st.floats(-11.0, 11.0), right=st.floats(-11.0, 11.0), yaw=st.floats(-3.1, 3.1))
@settings(max_examples=50, deadline=None)
def test_wheel_speeds_reach_the_reference(servo, kinematics, left, right, yaw):
    start = Pose2(1.0, -2.0, yaw)
    speeds = servo.speeds(start, kinematics.odometry(start, left * _PERIOD_S, right * _PERIOD_S))
    # mink's step is of first order: exact for a straight line or a turn on the spot, nearly so for an arc.
    assert speeds == pytest.approx([left, right], abs=0.02)


def test_a_sideways_error_moves_no_wheel(servo):
    speeds = servo.speeds(Pose2(0.0, 0.0, 0.0), Pose2(0.0, 0.002, 0.0))
    assert speeds == pytest.approx([0.0, 0.0], abs=1e-6)


def test_no_wheel_exceeds_its_limit(servo):
    start = Pose2(0.0, 0.0, 0.5)
    for forward_m, turn_rad in ((1.0, 0.0), (-1.0, 0.0), (0.0, 2.0), (0.5, -1.0)):
        speeds = servo.speeds(start, move_pose(start, forward_m, turn_rad))
        assert np.abs(speeds).max() == pytest.approx(_MAX_RADPS, abs=1e-6)


@pytest.mark.parametrize(("forward_m", "turn_rad"), [(0.065, 0.0), (0.0, math.radians(10.0))])
def test_an_action_is_reached_in_a_few_periods(servo, kinematics, forward_m, turn_rad):
    pose = Pose2(0.4, 0.1, -2.0)
    reference = move_pose(pose, forward_m, turn_rad)
    for _ in range(8):
        speeds = servo.speeds(pose, reference)
        pose = kinematics.odometry(pose, *(speeds * _PERIOD_S))
    assert (pose.x_m, pose.y_m, pose.yaw_rad) == pytest.approx(
        (reference.x_m, reference.y_m, reference.yaw_rad), abs=1e-6
    )


def test_no_slip_constraint(kinematics):
    model = mujoco.MjModel.from_xml_path(str(ROBOT_XML))
    configuration = mink.Configuration(model)
    no_slip = NoSlip(kinematics, model)
    # At yaw 0 MuJoCo's velocity is: linear x, y, z; angular x, y, z; left and right wheel.
    forward_mps, turn_radps = kinematics.body_motion(3.0, 7.0)
    rolling = np.array([forward_mps, 0.0, 0.0, 0.0, 0.0, turn_radps, 3.0, 7.0])
    np.testing.assert_allclose(no_slip.compute_jacobian(configuration) @ rolling, 0.0, atol=1e-12)
    sideways = rolling + np.array([0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert np.abs(no_slip.compute_jacobian(configuration) @ sideways).max() == pytest.approx(0.1)
    assert np.linalg.matrix_rank(no_slip.compute_jacobian(configuration)) == 6


def test_no_solution_stops_the_wheels(servo, monkeypatch):
    def find_nothing(*_, **__):
        raise mink.NoSolutionFound("daqp")

    monkeypatch.setattr(mink, "solve_ik", find_nothing)
    assert servo.speeds(Pose2(0.0, 0.0, 0.0), Pose2(0.1, 0.0, 0.0)).tolist() == [0.0, 0.0]
