"""Converts a path to velocities by pure pursuit, for continuous control (see scripts/continuous_control.py)."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from anm_mj.frames import wrap_angle
from anm_mj.types import ARRIVED_M, Pose2, Twist

LOOKAHEAD_M = 0.25
"""Distance from the robot to the pursued point of the path [m]."""
TURN_FIRST_RAD = math.radians(35.0)
"""Larger heading errors cause a turn on the spot first [rad]."""
SPEED_MPS = 0.4
"""Forward speed [m/s]; lower in tight curves."""
TURN_RADPS = 1.2
"""Turn rate on the spot, and the highest one while driving [rad/s]."""


class Pursuit:
    """Follows a polyline to its end.

    Source: Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, CMU-RI-TR-92-01, 1992.
    """

    def __init__(self, path_xy_m: Float[np.ndarray, "k 2"]):
        """Start at the path's first point; it has two points or more, world [m]."""
        self._points = path_xy_m
        self._leg = 0

    def twist(self, pose: Pose2) -> Twist | None:
        """The velocity at a pose; None at the end of the path."""
        if math.dist(self._points[-1], pose.xy_m) < ARRIVED_M:
            return None
        ahead = self._pursued(pose.xy_m) - pose.xy_m
        error_rad = wrap_angle(math.atan2(ahead[1], ahead[0]) - pose.yaw_rad)
        if abs(error_rad) > TURN_FIRST_RAD:
            return Twist(0.0, math.copysign(TURN_RADPS, error_rad))
        curvature = 2.0 * math.sin(error_rad) / max(float(np.linalg.norm(ahead)), 0.05)
        speed_mps = min(SPEED_MPS, TURN_RADPS / max(abs(curvature), 1e-9))
        return Twist(speed_mps, speed_mps * curvature)

    def _pursued(self, xy_m: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
        """The first point of the path at the lookahead distance, from the present segment on."""
        for leg in range(self._leg, len(self._points) - 1):
            start, end = self._points[leg], self._points[leg + 1]
            if math.dist(end, xy_m) > LOOKAHEAD_M:
                self._leg = leg
                return _at_distance(start, end, xy_m)
        return self._points[-1]


def _at_distance(
    start: Float[np.ndarray, "2"], end: Float[np.ndarray, "2"], xy_m: Float[np.ndarray, "2"]
) -> Float[np.ndarray, "2"]:
    """Where a segment leaves the lookahead circle about a place; outside of the circle, its nearest point."""
    along, from_place = end - start, start - xy_m
    a, b = float(along @ along), float(from_place @ along)
    c = float(from_place @ from_place) - LOOKAHEAD_M**2
    root = b * b - a * c
    t = (-b + math.sqrt(root)) / a if root > 0.0 else -b / a
    return start + float(np.clip(t, 0.0, 1.0)) * along
