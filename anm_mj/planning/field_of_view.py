"""What the robot's camera can show from a place: read off an observation, so that no stage assumes a camera."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from anm_mj.frames import wrap_angle
from anm_mj.types import TURN_STEP_RAD, Footprint, Observation

_DIGITS = 6
"""The same camera read off two poses differs in the last digits."""
_PITCH_DIGITS = 3
"""A base on wheels nods by less than this when it starts and stops."""
_AZIMUTH_DIGITS = 2
"""A base that rolls turns a tilted camera aside by less than half of the last of these."""
_LEVEL = 1e-6
"""An axis with a shorter horizontal part looks straight up or down."""
STEEPEST_RAD = math.radians(75.0)
"""Rays are looked at up to this far from the horizontal [rad]; steeper ones show the floor or ceiling beside the
robot."""
_TURN_S = 0.4
"""A turn takes at least so long [s]."""


def turns_to_look_around(observation: Observation) -> int:
    """Turn steps after which the camera that took an observation has shown all azimuths.

    An image that comes late was taken before its turn had ended: there are more turns then.
    """
    late = math.ceil(max(observation.image_age_s, 0.0) / _TURN_S)
    return FieldOfView.of(observation).turns_for_panorama + late


@dataclass(frozen=True)
class FieldOfView:
    """The angles that a camera covers, where it sits, and how far it measures."""

    tan_left: float
    """Tangent of the angle from the optical axis to the left edge of the image."""
    tan_right: float
    tan_up: float
    """Tangent of the angle from the optical axis to the top edge."""
    tan_down: float
    pitch_rad: float
    """Elevation of the optical axis, positive upwards."""
    height_m: float
    """Height of the camera above the floor [m]."""
    range_m: float = math.inf
    """Largest depth that the camera measures [m]."""
    azimuth_rad: float = 0.0
    """Where the optical axis points beside the base's heading, positive to the left; exactly 0 for straight ahead."""

    @classmethod
    def of(cls, observation: Observation) -> FieldOfView:
        """The field of view of the camera that took an observation.

        A late image was taken before the base came to its pose: its camera counts as one that looks straight ahead.
        """
        k, axis = observation.intrinsics, observation.T_world_camera[:3, 2]
        tangents = (k.cx / k.fx, (k.width - k.cx) / k.fx, k.cy / k.fy, (k.height - k.cy) / k.fy)
        pitch = math.atan2(float(axis[2]), float(np.hypot(axis[0], axis[1])))
        # Adding zero turns a minus zero into zero.
        left, right, up, down = (round(value, _DIGITS) for value in tangents)
        pitch = round(pitch, _PITCH_DIGITS) + 0.0
        height_m, azimuth = float(observation.T_world_camera[2, 3]), 0.0
        if not observation.image_age_s and np.hypot(axis[0], axis[1]) > _LEVEL:
            aside = wrap_angle(math.atan2(float(axis[1]), float(axis[0])) - observation.pose.yaw_rad)
            azimuth = round(aside, _AZIMUTH_DIGITS) + 0.0
        return cls(left, right, up, down, pitch, height_m, observation.range_m, azimuth)

    @property
    def width_rad(self) -> float:
        """Azimuths that the middle row of the image covers [rad]."""
        return sum(math.atan(tangent / math.cos(self.pitch_rad)) for tangent in (self.tan_left, self.tan_right))

    @property
    def side_sectors(self) -> int:
        """Turn steps on either side of the middle one that come nearest to the width."""
        return max(round((self.width_rad / TURN_STEP_RAD - 1.0) / 2.0), 0)

    @property
    def turns_for_panorama(self) -> int:
        """Turn steps after which the camera has shown all azimuths."""
        return max(math.ceil((math.tau - self.width_rad) / TURN_STEP_RAD - 1e-6), 0)

    @property
    def corner_ratio(self) -> float:
        """Distance per depth of the farthest edge of the image, in its middle row."""
        return math.sqrt(1.0 + max(self.tan_left, self.tan_right) ** 2)

    def slopes(self, share: float = 1.0) -> tuple[float, float]:
        """Rise per horizontal metre of the lowest and the highest rays in the middle of the image.

        ``share`` is how far these lie from the optical axis to the edges.
        """
        ends = []
        for tangent in (-share * self.tan_down, share * self.tan_up):
            angle = math.atan(tangent) + self.pitch_rad
            level = self.pitch_rad == 0.0 and abs(angle) <= STEEPEST_RAD
            ends.append(tangent if level else math.tan(min(max(angle, -STEEPEST_RAD), STEEPEST_RAD)))
        return ends[0], ends[1]

    def blind_radius_m(self, footprint: Footprint, share: float) -> float:
        """Distance from which on the camera shows a share of the heights of the robot's body [m]; +inf where never."""
        low, high = self.slopes()
        distance_m = np.arange(0.0, 8.0, 0.05)
        top = np.minimum(self.height_m + high * distance_m, footprint.z_max_m)
        bottom = np.maximum(self.height_m + low * distance_m, footprint.z_min_m)
        enough = top - bottom >= share * (footprint.z_max_m - footprint.z_min_m)
        return float(distance_m[enough.argmax()]) if enough.any() else math.inf
