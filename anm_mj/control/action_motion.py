"""Motion of the base for a discrete action: distance, angle and velocity profile."""

import math

from anm_mj.control.speed_and_acceleration import MotionLimits
from anm_mj.types import FORWARD_STEP_M, TURN_STEP_RAD, Action

_MOTIONS = {
    Action.STOP: (0.0, 0.0),
    Action.MOVE_FORWARD: (FORWARD_STEP_M, 0.0),
    Action.TURN_LEFT: (0.0, TURN_STEP_RAD),
    Action.TURN_RIGHT: (0.0, -TURN_STEP_RAD),
    Action.WAIT: (0.0, 0.0),
}


def action_motion(action: Action) -> tuple[float, float]:
    """Forward distance [m] and turn [rad] of an action; at least one of the two is 0."""
    return _MOTIONS[action]


class Trapezoid:
    """Trapezoidal velocity profile from rest to rest.

    Source: Lynch and Park, Modern Robotics, 2017, section 9.2.2.2 (trapezoidal time scaling).
    """

    def __init__(self, length: float, max_speed: float, acceleration: float):
        """All positive and in one unit: m, m/s and m/s², or rad, rad/s and rad/s²."""
        self._length, self._acceleration = length, acceleration
        # A short motion never reaches the highest speed.
        self._speed = min(max_speed, math.sqrt(length * acceleration))
        self._ramp_s = self._speed / acceleration
        self.duration_s = length / self._speed + self._ramp_s

    def fraction(self, time_s: float) -> float:
        """Fraction of the length covered at a time after the start [s], in [0, 1]."""
        t = min(max(time_s, 0.0), self.duration_s)
        if t < self._ramp_s:
            return 0.5 * self._acceleration * t**2 / self._length
        if t > self.duration_s - self._ramp_s:
            return 1.0 - 0.5 * self._acceleration * (self.duration_s - t) ** 2 / self._length
        return self._speed * (t - 0.5 * self._ramp_s) / self._length


def action_profile(action: Action, limits: MotionLimits) -> Trapezoid:
    """Velocity profile of an action other than STOP; a wait lasts as long as a turn."""
    forward_m, turn_rad = action_motion(action)
    if forward_m:
        return Trapezoid(forward_m, limits.forward_mps, limits.forward_mps2)
    return Trapezoid(abs(turn_rad) or TURN_STEP_RAD, limits.turn_radps, limits.turn_radps2)
