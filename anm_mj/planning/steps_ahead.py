"""Whether the next forward steps are free: of the map's obstacles, and of what moves; asked at every step."""

import math
from collections.abc import Sequence

import numpy as np

from anm_mj.sensing.moving_things import MovingThing
from anm_mj.types import FORWARD_STEP_M, OCCUPIED, Footprint, OccupancyGrid, Pose2

REACH_M = 2 * FORWARD_STEP_M
"""The two forward steps that must be free [m]: a person steps as far meanwhile."""
KEPT_M, KEPT_STANDING_M = 0.2, 0.07
"""The robot stays so far from what moves, and from what has moved and stands [m]."""
_LOOK_AHEAD_S = (0.0, 0.5, 1.0)


def lookahead_radius_m(footprint: Footprint) -> float:
    """How far from its place a robot sees obstacles by :func:`path_is_blocked`, along both axes [m]."""
    return footprint.radius_m + REACH_M


def path_is_blocked(grid: OccupancyGrid, footprint: Footprint, pose: Pose2) -> bool:
    """Whether the next forward steps bring occupied voxels into the body, and nearer than any is now. Only the few that
    they would touch are looked at.

    The robot would move along its heading; the grid is of now within :func:`lookahead_radius_m`.
    """
    resolution = grid.resolution_m
    around = footprint.radius_m + REACH_M + resolution
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
    nearest = np.hypot(ahead - np.clip(ahead, 0.0, REACH_M), aside).min()
    return bool(nearest < min(footprint.radius_m, nearest_now - resolution / 4))


def in_the_way(things: Sequence[MovingThing], footprint: Footprint, pose: Pose2, time_s: float) -> MovingThing | None:
    """What forward steps from a pose lead nearer to, now or within a second, than they may; None for nothing."""
    heading = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
    for thing in things:
        kept_m = (KEPT_STANDING_M if thing.stands else KEPT_M) + thing.spread_m(time_s)
        least_m = footprint.radius_m + thing.radius_m + kept_m
        for ahead_s in _LOOK_AHEAD_S:
            x_m, y_m = thing.after(time_s + ahead_s)
            dx, dy = x_m - pose.x_m, y_m - pose.y_m
            along_m = dx * heading[0] + dy * heading[1]
            # A step leads away from what is beside or behind.
            if along_m <= 0.0:
                continue
            aside_m = abs(dy * heading[0] - dx * heading[1])
            if math.hypot(max(along_m - REACH_M, 0.0), aside_m) < least_m:
                return thing
    return None


def held_disc(thing: MovingThing, footprint: Footprint, pose: Pose2, time_s: float) -> tuple[float, float, float]:
    """The disc, by x, y and radius [m], that paths around a thing keep off; the robot is not in it."""
    x_m, y_m = thing.after(time_s)
    room_m = math.dist((x_m, y_m), pose.xy_m) - footprint.radius_m
    return x_m, y_m, max(0.0, min(thing.radius_m + KEPT_STANDING_M, room_m - KEPT_STANDING_M))
