"""Whether the next forward steps are still free, from the few voxels that they would touch; asked at every step."""

import math

import numpy as np

from anm_mj.types import FORWARD_STEP_M, OCCUPIED, Footprint, OccupancyGrid, Pose2

LOOKAHEAD_STEPS = 2
"""Forward steps that must be free."""


def lookahead_radius_m(footprint: Footprint) -> float:
    """How far from its place a robot sees obstacles by :func:`path_is_blocked`, along both axes [m]."""
    return footprint.radius_m + LOOKAHEAD_STEPS * FORWARD_STEP_M


def path_is_blocked(grid: OccupancyGrid, footprint: Footprint, pose: Pose2) -> bool:
    """Whether the next forward steps bring occupied voxels into the body, and nearer than any is now.

    The robot would move along its heading; the grid is of now within :func:`lookahead_radius_m`.
    """
    reach = LOOKAHEAD_STEPS * FORWARD_STEP_M
    resolution = grid.resolution_m
    around = footprint.radius_m + reach + resolution
    low = np.floor((pose.xy_m - around - grid.origin_m[:2]) / resolution).astype(int)
    high = np.ceil((pose.xy_m + around - grid.origin_m[:2]) / resolution).astype(int)
    body = grid.layers_between(footprint.z_min_m, footprint.z_max_m)
    rows, cols = (slice(max(low[i], 0), max(high[i], 0)) for i in (1, 0))
    occupied = (grid.state[body, rows, cols] == OCCUPIED).any(axis=0)
    row, col = np.nonzero(occupied)
    if not len(row):
        return False
    x = grid.origin_m[0] + (col + cols.start + 0.5) * resolution - pose.x_m
    y = grid.origin_m[1] + (row + rows.start + 0.5) * resolution - pose.y_m
    ahead = x * math.cos(pose.yaw_rad) + y * math.sin(pose.yaw_rad)
    aside = -x * math.sin(pose.yaw_rad) + y * math.cos(pose.yaw_rad)
    nearest_now = np.hypot(ahead, aside).min()
    nearest = np.hypot(ahead - np.clip(ahead, 0.0, reach), aside).min()
    return bool(nearest < min(footprint.radius_m, nearest_now - resolution / 4))
