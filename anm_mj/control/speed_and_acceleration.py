"""Limits of speed and acceleration: the defaults, and what a robot's wheels reach and does not tip it over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from anm_mj.types import Twist

if TYPE_CHECKING:
    from anm_mj.robot.description import RobotDescription

_GRAVITY_MPS2 = 9.81
_LEAST_MPS2 = 0.3
"""A robot that would tip at this acceleration already tips anyway [m/s²]."""


@dataclass(frozen=True)
class MotionLimits:
    """Highest forward speed and turn rate of the base, and its accelerations, which are decelerations too. At the
    defaults the wheels of ``models/diff_drive`` do not slip.
    """

    forward_mps: float = 0.5
    forward_mps2: float = 1.5
    turn_radps: float = 1.8
    turn_radps2: float = 6.0


def clipped(wanted: Twist, limits: MotionLimits) -> Twist:
    """A velocity within the highest forward speed and turn rate; each is clipped by itself."""
    return Twist(_within(wanted.forward_mps, limits.forward_mps), _within(wanted.turn_radps, limits.turn_radps))


def slewed(now: Twist, wanted: Twist, limits: MotionLimits, period_s: float) -> Twist:
    """The velocity a period [s] after ``now``, within the accelerations, on the way to a wanted one."""
    return Twist(
        now.forward_mps + _within(wanted.forward_mps - now.forward_mps, limits.forward_mps2 * period_s),
        now.turn_radps + _within(wanted.turn_radps - now.turn_radps, limits.turn_radps2 * period_s),
    )


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


def _within(value: float, most: float) -> float:
    return min(max(value, -most), most)
