"""Decides from raw depth whether something is in the way of a robot that is driven over ROS."""

import math

import numpy as np
from jaxtyping import Float, Float32

from anm_mj.frames import pixel_directions
from anm_mj.ros.drive_config import RosConfig
from anm_mj.types import Intrinsics

_REACTION_S = 0.15
"""What a robot drives before a command is effective: images, wire and motors are late by this [s]."""
_POINTS = 5000
"""About so many pixels are looked at for obstacles."""
_FEWEST = 4
"""Fewer points are noise rather than an obstacle."""


def free_way_m(
    depth_m: Float32[np.ndarray, "h w"],
    camera: Intrinsics,
    T_base_camera: Float[np.ndarray, "4 4"],
    half_width_m: float,
    heights_m: tuple[float, float],
) -> float:
    """How far ahead of its axis a robot's way is free, by raw depth [m]; +inf where nothing is seen in it. Depth is
    planar; ``half_width_m`` is that of the way, ``heights_m`` are the lower and the upper end of what meets the robot.
    """
    every = max(1, round(math.sqrt(depth_m.size / _POINTS)))
    depth = depth_m[::every, ::every].astype(float)
    there = np.isfinite(depth)
    points = pixel_directions(camera)[::every, ::every][there] * depth[there][:, None]
    x, y, z = T_base_camera[:3, :3] @ points.T + T_base_camera[:3, 3:]
    low, high = heights_m
    ahead = np.sort(x[(np.abs(y) < half_width_m) & (z > low) & (z < high) & (x > 0.0)])
    return float(ahead[_FEWEST - 1]) if len(ahead) >= _FEWEST else math.inf


def is_way_blocked(way_m: float, forward_mps: float, reach_m: float, config: RosConfig) -> bool:
    """Whether a robot that goes forward must stop for what it would meet, way to rest included.

    Args:
        way_m: What :func:`free_way_m` gave [m].
        forward_mps: How fast the robot is now [m/s].
        reach_m: It is to stop within so far anyway [m].
        config: Radius, clearance and braking of the robot.
    """
    speed = max(forward_mps, 0.0)
    braking_m = speed * _REACTION_S + speed**2 / (2.0 * config.forward_mps2)
    return way_m < config.radius_m + config.clearance_m + min(braking_m, reach_m)
