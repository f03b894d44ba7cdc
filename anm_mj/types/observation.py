"""What the robot perceives, from where, with what."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8


class PixelState(IntEnum):
    """What a pixel of a depth image is; the first two tell where free space is."""

    MEASURED = 0
    OUT_OF_RANGE = 1
    """The sensor says that it looked farther than its range."""
    LOST = 2
    """Nothing was measured."""
    OUTLIER = 3
    """Something was measured that the pixels beside it contradict."""
    MOVED = 4
    """Something was measured that moves, or has just come."""


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera without distortion; pixel (u, v) has its centre at (u + 0.5, v + 0.5)."""

    width: int
    """Columns [px]."""
    height: int
    """Rows [px]."""
    fx: float
    """Focal length along u [px]."""
    fy: float
    """Focal length along v [px]."""
    cx: float
    """Principal point along u [px], measured from the left edge of the image."""
    cy: float
    """Principal point along v [px], measured from the top edge of the image."""

    @classmethod
    def from_fov(cls, width: int, height: int, fov_y_rad: float) -> Intrinsics:
        """Square-pixel intrinsics of a camera with vertical field of view ``fov_y_rad`` and a centred axis."""
        f = height / 2.0 / math.tan(fov_y_rad / 2.0)
        return cls(width, height, f, f, width / 2.0, height / 2.0)

    def scaled(self, width: int, height: int, *, first_of_block: bool = False) -> Intrinsics:
        """Those of the same image at another size [px]. ``first_of_block``: each pixel of the smaller image is the
        first of its block of the larger one instead of the block's mean or middle.
        """
        x, y = width / self.width, height / self.height
        # The first pixel of a block has its centre half a pixel of the larger image from the block's corner.
        u, v = (0.5 * (1.0 - x), 0.5 * (1.0 - y)) if first_of_block else (0.0, 0.0)
        return Intrinsics(width, height, self.fx * x, self.fy * y, self.cx * x + u, self.cy * y + v)


@dataclass(frozen=True)
class Pose2:
    """Where the robot's base stands, in the world."""

    x_m: float
    """World x [m]."""
    y_m: float
    """World y [m]."""
    yaw_rad: float
    """Counter-clockwise from world x, in (-pi, pi]."""

    @property
    def xy_m(self) -> Float[np.ndarray, "2"]:
        """Position as an array [m]."""
        return np.array([self.x_m, self.y_m], float)


WIDE_M = 0.5
"""Robots of this width are wide [m]."""


@dataclass(frozen=True)
class Footprint:
    """The space a robot sweeps: an upright cylinder about its base."""

    radius_m: float
    """Of the cylinder [m]."""
    z_min_m: float
    """Lower obstacles do not matter [m]: the robot drives over them."""
    z_max_m: float
    """Height of the robot's top [m]."""

    @property
    def is_wide(self) -> bool:
        """Whether common inner doors leave the robot little room."""
        return 2.0 * self.radius_m >= WIDE_M


DEFAULT_FOOTPRINT = Footprint(radius_m=0.18, z_min_m=0.05, z_max_m=1.35)
"""Of the robot in ``models/diff_drive``."""


@dataclass(frozen=True)
class Observation:
    """What the robot perceives between two actions."""

    step: int
    """Number of actions executed before this observation; the first is 0."""
    time_s: float
    """Simulated time, that of the pose [s]."""
    rgb: UInt8[np.ndarray, "h w 3"]
    """Colour, row 0 at the top."""
    depth_m: Float32[np.ndarray, "h w"]
    """Planar z [m]; +inf where the sensor looked farther than its range, NaN where it measured nothing."""
    intrinsics: Intrinsics
    """Of colour and depth."""
    T_world_camera: Float[np.ndarray, "4 4"]
    """Camera to world; camera axes x right, y down, z forward."""
    pose: Pose2
    """Where the base stands, as the robot believes it."""
    range_m: float = math.inf
    """Largest planar depth that the camera measures, by its maker's word [m]; +inf where nobody says."""
    shown_range_m: float = math.inf
    """Largest planar depth that its images have shown [m]; +inf where the camera itself says what is beyond its range,
    and until the robot has looked around."""
    pixel_state: UInt8[np.ndarray, "h w"] | None = None
    """What each pixel is (:class:`PixelState`); None before :func:`anm_mj.sensing.pixel_state.judge_pixels`."""
    moved_m: Float32[np.ndarray, "h w"] | None = None
    """Planar depth of the pixels that moved [m], NaN elsewhere; ``depth_m`` has none there. None where none moved."""
    position_deviation_m: float = 0.0
    """Largest standard deviation of the position in the map, in any direction [m]; 0 where nobody estimates it."""
    heading_deviation_rad: float = 0.0
    """That of the rotation about any axis [rad], likewise."""
    image_age_s: float = 0.0
    """By its stamp the image was taken so long before ``time_s`` [s]; ``T_world_camera`` is of then."""

    @property
    def known_range_m(self) -> float:
        """Largest planar depth that its maker or its images vouch for [m]; +inf where neither does."""
        return min(self.range_m, self.shown_range_m)


@dataclass(frozen=True)
class TruePeople:
    """What moves in the scene at an observation; for the evaluation, never for the robot."""

    states: Float[np.ndarray, "n 5"]
    """Of people: x [m], y [m], yaw [rad], phase of the gait [rad], and how far the limbs swing, in [0, 1]."""
    shown: Bool[np.ndarray, "h w"]
    """The pixels that show people or vacuum robots."""
    nearest_m: float
    """Between the robot's body and the nearest one of people and things [m]."""
    chair: tuple[float, float, float] | None = None
    """Where the chair that is pushed stands: x [m], y [m], yaw [rad]; None without."""
    standing_shown: Bool[np.ndarray, "h w"] | None = None
    """The pixels that show the chair or a leaf of a door: surface while it stands, moved right after it was pushed, so
    neither is wrong. None without."""
    vacuums: Float[np.ndarray, "v 3"] = field(default_factory=lambda: np.zeros((0, 3)))
    """Of vacuum robots: x [m], y [m], yaw [rad]."""
    doors: Float[np.ndarray, "d 4"] = field(default_factory=lambda: np.zeros((0, 4)))
    """Of leaves of doors: x and y of the hinge [m], yaw from there along the leaf [rad], length [m]."""


@dataclass(frozen=True)
class TrueView:
    """What an observation was truly made of; for the evaluation, never for the robot."""

    pose: Pose2
    """Where the base stood."""
    T_world_camera: Float[np.ndarray, "4 4"]
    """Camera to world; camera axes x right, y down, z forward."""
    depth_m: Float32[np.ndarray, "h w"]
    """Exact planar z where the sensor gave a value [m]; not finite elsewhere, nor where it shows what moves."""
    people: TruePeople | None = None
    """None where nobody is in the scene."""
