"""A path as velocities: pure pursuit of a point ahead, for robots that are driven continuously."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from anm_mj.frames import wrap_angle
from anm_mj.types import ARRIVED_M, Pose2, Twist

AHEAD_M = 0.25
"""The point pursued lies this far ahead on the path [m]."""
TURN_FIRST_RAD = math.radians(35.0)
"""Headings farther off than this are turned to on the spot before driving on [rad]."""
SPEED_MPS = 0.4
TURN_RADPS = 1.2
"""Turn rate on the spot, and the highest while driving [rad/s]."""


class Pursuit:
    """Follows a polyline to its end.

    Source: Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, CMU-RI-TR-92-01, 1992.
    """

    def __init__(self, path_xy_m: Float[np.ndarray, "k 2"]):
        """Start at the path's beginning.

        Args:
            path_xy_m: two points or more.
        """
        self._points = path_xy_m
        self._leg = 0

    def twist(self, pose: Pose2) -> Twist | None:
        """The velocity to drive at now; None at the end of the path."""
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
        """The first point on the path, from the leg reached so far on, that is as far away as it should be."""
        for leg in range(self._leg, len(self._points) - 1):
            start, end = self._points[leg], self._points[leg + 1]
            if math.dist(end, xy_m) > AHEAD_M:
                self._leg = leg
                return _at_distance(start, end, xy_m)
        return self._points[-1]


def _at_distance(
    start: Float[np.ndarray, "2"], end: Float[np.ndarray, "2"], xy_m: Float[np.ndarray, "2"]
) -> Float[np.ndarray, "2"]:
    """Where a leg leaves the circle of AHEAD_M about a place; the leg's point nearest to it when it lies outside."""
    along, from_place = end - start, start - xy_m
    a, b = float(along @ along), float(from_place @ along)
    c = float(from_place @ from_place) - AHEAD_M**2
    root = b * b - a * c
    t = (-b + math.sqrt(root)) / a if root > 0.0 else -b / a
    return start + float(np.clip(t, 0.0, 1.0)) * along
