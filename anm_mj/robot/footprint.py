"""The space that a robot sweeps: an upright cylinder about its base."""

from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.errors import RobotError
from anm_mj.robot.body_tree import solid_geoms
from anm_mj.robot.geom_extent import height_range_m, radius_about_axis_m
from anm_mj.types import Footprint

FOOTPRINT_MARGIN_M = 0.01
"""The footprint is wider than the robot by this margin [m]."""
WIDEST_M, HIGHEST_M = 2.0, 4.0
"""Larger robots, by radius and height, are not in metres [m]."""
LOWEST_M = 0.05
"""Rugs and thresholds below this height are no obstacles [m]; scenes have no collision boxes there either."""


def robot_footprint(
    model: mujoco.MjModel, data: mujoco.MjData, T_world_base: Float[np.ndarray, "4 4"]
) -> tuple[Footprint, float]:
    """The upright cylinder about the base that encloses the robot, joints locked, and the robot's own radius [m]."""
    solid = solid_geoms(model)
    floor_z = float(T_world_base[2, 3])
    radius = max(radius_about_axis_m(model, data, g, T_world_base[:2, 3]) for g in solid)
    # Wheels count: what passes below a high body does not pass below them.
    heights = [height_range_m(model, data, g) for g in solid]
    lowest, highest = min(low for low, _ in heights) - floor_z, max(high for _, high in heights) - floor_z
    footprint = Footprint(
        radius_m=round(radius + FOOTPRINT_MARGIN_M, 6),
        z_min_m=round(max(lowest, LOWEST_M), 6),
        z_max_m=round(max(highest, LOWEST_M + 0.05), 6),
    )
    return footprint, round(radius, 6)


def require_size(footprint: Footprint, path: Path) -> None:
    """Accept a robot that fits buildings. Raises RobotError if it is too large, as in a file in centimetres."""
    if footprint.radius_m > WIDEST_M or footprint.z_max_m > HIGHEST_M:
        raise RobotError(
            f"The robot {path} is {2.0 * footprint.radius_m:.3g} m across and {footprint.z_max_m:.3g} m high; MuJoCo's "
            "unit is the metre: scale the file, or choose a key frame in which it is compact by --set "
            "model.keyframe=NAME."
        )
