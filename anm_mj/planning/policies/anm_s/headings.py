"""Where the robot turns to on arrival, and what lies ahead of it."""

import functools
import math

import numpy as np
from jaxtyping import Float

from anm_mj.frames import pixel_directions, wrap_angle
from anm_mj.types import Intrinsics, Observation, Region

PIXEL_STEP = 4
"""Every so many columns and rows of a view are read to find how far it reaches [px]."""


def view_headings(
    regions: tuple[Region, ...],
    xy_m: Float[np.ndarray, "2"],
    yaw_rad: float,
    well_in_view_rad: float,
    azimuth_rad: float = 0.0,
) -> tuple[float, ...]:
    """Yaws to turn to, one after the other, until every region has been well in view.

    The robot stands at a place [m] with a heading [rad], beside which its camera looks by ``azimuth_rad``; a region
    this far off the camera's axis is well in view.
    """
    headings: list[float] = []
    left = list(regions)
    while left:
        axis_rad = yaw_rad + azimuth_rad
        left.sort(key=lambda region: abs(off_axis(region, xy_m, axis_rad)))
        error = off_axis(left.pop(0), xy_m, axis_rad)
        if abs(error) > well_in_view_rad:
            yaw_rad = wrap_angle(yaw_rad + error - math.copysign(well_in_view_rad, error))
            headings.append(yaw_rad)
    return tuple(headings)


def off_axis(region: Region, xy_m: Float[np.ndarray, "2"], yaw_rad: float) -> float:
    """Angle from a heading to a region, counter-clockwise [rad]."""
    towards = region.centre_m[:2] - xy_m
    return wrap_angle(math.atan2(towards[1], towards[0]) - yaw_rad)


def view_box(view: Observation) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """Lower and upper corner of all that a view shows, in world x and y [m]."""
    rays = _rays(view.intrinsics)
    depth = view.depth_m[::PIXEL_STEP, ::PIXEL_STEP, None]
    # A pixel that looked beyond the range has no place.
    depth = np.where(np.isfinite(depth), depth, np.float32(np.nan))
    points = (rays * depth) @ view.T_world_camera[:2, :3].T
    points = points[np.isfinite(points).all(axis=-1)]
    here = view.T_world_camera[:2, 3]
    corners = np.concatenate([np.zeros((1, 2)), points]) + here
    return corners.min(axis=0), corners.max(axis=0)


@functools.lru_cache(maxsize=1)
def _rays(intrinsics: Intrinsics) -> Float[np.ndarray, "h w 3"]:
    """Rays through every so many pixels, in camera axes."""
    return pixel_directions(intrinsics)[::PIXEL_STEP, ::PIXEL_STEP].copy()
