"""Motion of the base for a discrete action: distance, angle and velocity profile, within limits of speed and
acceleration that a robot's wheels reach and that do not tip it over.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from anm_mj.types import FORWARD_STEP_M, TURN_STEP_RAD, Action

if TYPE_CHECKING:
    from anm_mj.robot.description import RobotDescription

_GRAVITY_MPS2 = 9.81
_LEAST_MPS2 = 0.3
"""A robot that would tip at this acceleration already tips anyway [m/s²]."""
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


def action_profile(action: Action, limits: MotionLimits) -> Trapezoid:
    """Velocity profile of an action other than STOP; a wait lasts as long as a turn."""
    forward_m, turn_rad = action_motion(action)
    if forward_m:
        return Trapezoid(forward_m, limits.forward_mps, limits.forward_mps2)
    return Trapezoid(abs(turn_rad) or TURN_STEP_RAD, limits.turn_radps, limits.turn_radps2)


def limits_of(robot: RobotDescription, max_wheel_radps: float) -> MotionLimits:
    """The default limits, lowered to what a robot's wheels reach at ``max_wheel_radps`` and what does not tip it over.

    Half the acceleration is allowed at which the wheels or casters on one side lift off, for a body that is rigid.
    """
    most = MotionLimits()
    if not robot.wheel_joints:
        return most
    # A reserve of speed lets the servo catch up.
    rim_mps = 0.9 * max_wheel_radps * robot.wheel_radius_m
    turn_radps = min(most.turn_radps, 2.0 * rim_mps / (robot.track_m * robot.track_scale))
    x, height_m = float(robot.centre_of_mass_m[0]), float(robot.centre_of_mass_m[2])
    along = robot.support_xy_m[:, 0]
    margin_m = min(float(along.max()) - x, x - float(along.min()))
    forward_mps2 = min(most.forward_mps2, max(0.5 * _GRAVITY_MPS2 * margin_m / max(height_m, 1e-3), _LEAST_MPS2))
    return MotionLimits(min(most.forward_mps, rim_mps), forward_mps2, turn_radps, most.turn_radps2)


@dataclass(frozen=True)
class MotionLimits:
    """Highest forward speed and turn rate of the base, and its accelerations, which are decelerations too. At the
    defaults the wheels of ``models/diff_drive`` do not slip.
    """

    forward_mps: float = 0.5
    forward_mps2: float = 1.5
    turn_radps: float = 1.8
    turn_radps2: float = 6.0


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
