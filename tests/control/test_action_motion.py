import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anm_mj.control.action_motion import Trapezoid, action_motion, action_profile
from anm_mj.control.speed_and_acceleration import MotionLimits
from anm_mj.types import Action


def test_actions_are_those_of_the_paper():
    assert action_motion(Action.STOP) == (0.0, 0.0)
    assert action_motion(Action.MOVE_FORWARD) == (0.065, 0.0)
    assert action_motion(Action.TURN_LEFT) == (0.0, math.radians(10.0))
    assert action_motion(Action.TURN_RIGHT) == (0.0, -math.radians(10.0))


@given(length=st.floats(0.01, 5.0), speed=st.floats(0.1, 2.0), acceleration=st.floats(0.2, 10.0))
def test_trapezoid_limits(length, speed, acceleration):
    profile = Trapezoid(length, speed, acceleration)
    times = np.linspace(0.0, profile.duration_s, 400)
    progress = np.array([profile.fraction(float(t)) for t in times]) * length
    velocity = np.diff(progress) / (times[1] - times[0])
    assert progress[0] == 0.0
    assert progress[-1] == pytest.approx(length)
    assert velocity.min() >= -1e-9
    assert velocity.max() <= speed * (1.0 + 1e-6)
    assert np.abs(np.diff(velocity)).max() <= acceleration * (times[1] - times[0]) * (1.0 + 1e-3)


def test_trapezoid_duration():
    assert Trapezoid(10.0, 0.5, 1.0).duration_s == pytest.approx(10.0 / 0.5 + 0.5)
    assert Trapezoid(0.04, 0.5, 1.0).duration_s == pytest.approx(2.0 * math.sqrt(0.04))


def test_action_duration():
    limits = MotionLimits()
    assert action_profile(Action.MOVE_FORWARD, limits).duration_s == pytest.approx(2.0 * math.sqrt(0.065 / 1.5))
    assert action_profile(Action.TURN_RIGHT, limits).duration_s == pytest.approx(
        2.0 * math.sqrt(math.radians(10.0) / 6.0)
    )
