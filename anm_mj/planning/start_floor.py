"""The floor about the start of a run, which the camera cannot see from there: how far out it counts as free.

A camera at the height of a head shows the heights of the robot's body only from some distance on. The robot has to
drive there before it can see where it drives. What stands there and is too low for the camera mostly goes on from
something that it does see: the end of a shelf, the seat before a chair's back. So the unseen floor counts as free only
away from obstacles, as far away as still leaves the robot a way out.
"""

from __future__ import annotations

import logging
import math

import numpy as np
from jaxtyping import Bool, Float, Float32, Int8
from scipy import ndimage

from anm_mj.frames import world_to_cell
from anm_mj.planning.config import PlanningConfig
from anm_mj.planning.distance_transform import capped_distance_cells
from anm_mj.planning.field_of_view import FieldOfView
from anm_mj.planning.grid_windows import Window, bounds, dilate, relative_to
from anm_mj.types import Footprint, VoxelGrid

_logger = logging.getLogger(__name__)

BLIND_SLACK_M = 0.15
"""What a camera at the start cannot see counts as free this much farther than by its geometry [m]: carving is
cautious."""
MAX_START_GAP_M = 0.5
"""A ring of unknown floor about the start that is no wider than this counts as free [m]."""
KEEP_OFF_M = 0.6
"""Unseen floor about the start counts as free farther than this from obstacles, or nearer where there is no way out
[m]."""
WAY_OUT_M = 0.2
"""The robot is out so far beyond the unseen floor [m]."""
_START_DIRECTIONS, _LEAST_DIRECTIONS, _START_SHARE = 72, 8, 0.75
"""Directions that the seen floor is looked for in, in how many of them it must be seen, and the share of these in which
the gap before it is to be bridged."""


def unseen_radius_m(camera: FieldOfView, footprint: Footprint, config: PlanningConfig) -> float:
    """Up to where the camera cannot see enough of the columns about the start to tell that they are free [m].

    Args:
        camera: what the robot sees with.
        footprint: the body whose heights count.
        config: the share of them that makes a column known.
    """
    blind_m = camera.blind_radius_m(footprint, config.free_share)
    if math.isinf(blind_m):
        _logger.warning(
            "The camera, %.2f m high and tilted by %.0f degrees, never shows %.0f %% of the heights of the robot's "
            "body (%.2f m to %.2f m): it sees no place as free. Tilt it down, or lower planning.free_share.",
            camera.height_m,
            math.degrees(camera.pitch_rad),
            100.0 * config.free_share,
            footprint.z_min_m,
            footprint.z_max_m,
        )
        return config.start_radius_m
    return max(config.start_radius_m, blind_m + BLIND_SLACK_M)


def radius_to_seen_floor_m(
    known: Int8[np.ndarray, "rows cols"], grid: VoxelGrid, start_xy_m: Float[np.ndarray, 2], unseen_m: float
) -> float:
    """Up to where the floor at the start counts as free, so that no ring of unknown floor encloses the robot [m].

    A noisy sensor sees the nearest floor later than the camera's geometry tells. The disc reaches as far out as the
    floor is seen free in three quarters of the directions in which nothing stands before.

    Args:
        known: 2 for columns with a hit, 1 for those that were seen free, 0 for others.
        grid: the occupancy that they are columns of.
        start_xy_m: the start [m].
        unseen_m: as :func:`unseen_radius_m` gave it.
    """
    cell = grid.resolution_m
    angle = np.arange(_START_DIRECTIONS) * math.tau / _START_DIRECTIONS
    reach_m = np.arange(0.0, unseen_m + MAX_START_GAP_M + cell / 2, cell)
    place = start_xy_m + reach_m[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    row, col = world_to_cell(place.reshape(-1, 2), grid.origin_m[:2], cell).T.reshape(2, *place.shape[:2])
    inside = (row >= 0) & (col >= 0) & (row < known.shape[0]) & (col < known.shape[1])
    seen = np.zeros(row.shape, np.int8)
    seen[inside] = known[row[inside], col[inside]]
    seen[(seen == 1) & (reach_m < unseen_m)[:, None]] = 0
    first = np.take_along_axis(seen, seen.astype(bool).argmax(axis=0)[None], axis=0)[0]
    free_m = reach_m[seen.astype(bool).argmax(axis=0)][first == 1]
    if len(free_m) < _LEAST_DIRECTIONS:
        return unseen_m
    return float(np.quantile(free_m, _START_SHARE, method="higher"))


def away_from_hits(
    floor: Bool[np.ndarray, "rows cols"], hit: Bool[np.ndarray, "rows cols"], window: Window, keep_off_cells: int
) -> Bool[np.ndarray, "r c"]:
    """The cells of a window that are unseen floor about a start, and farther from all hits than a distance.

    Args:
        floor: the floor about starts, in the whole map.
        hit: columns with a hit, in the whole map.
        window: the window.
        keep_off_cells: the distance; 0 for none [cells].
    """
    out = floor[window].copy()
    if not keep_off_cells:
        return out
    for part in bounds(out, window):
        around = dilate(part, keep_off_cells + 1, hit.shape)
        off = capped_distance_cells(~hit[around], keep_off_cells + 1)[relative_to(part, around)]
        out[relative_to(part, window)] &= off > keep_off_cells
    return out


def has_way_out(
    clearance_m: Float32[np.ndarray, "rows cols"],
    floor: Bool[np.ndarray, "rows cols"],
    robot_xy_cells: Float[np.ndarray, 2],
    *,
    safe_m: float,
    resolution_m: float,
) -> bool:
    """Whether the robot can leave the floor about the start where it stands.

    Args:
        clearance_m: of the whole map [m].
        floor: the floor about starts.
        robot_xy_cells: where the robot stands, from the corner of the map [cells].
        safe_m: clearance that its paths keep [m].
        resolution_m: edge of a cell [m].
    """
    beyond_cells = math.ceil(WAY_OUT_M / resolution_m)
    for part in bounds(floor, (slice(0, floor.shape[0]), slice(0, floor.shape[1]))):
        around = dilate(part, beyond_cells + 1, floor.shape)
        outside = capped_distance_cells(~floor[around], beyond_cells + 1) >= beyond_cells
        label = np.empty(outside.shape, np.int32)
        ndimage.label(clearance_m[around] >= safe_m, np.ones((3, 3)), output=label)  # pyright: ignore[reportArgumentType]
        col, row = np.floor(robot_xy_cells).astype(int) - (around[1].start, around[0].start)
        if not (0 <= row < len(outside) and 0 <= col < outside.shape[1]):
            return True
        # Paths begin where the robot stands, however narrow it is there.
        reach = math.ceil(safe_m / resolution_m)
        near = label[max(row - reach, 0) : row + reach + 1, max(col - reach, 0) : col + reach + 1]
        return bool(np.isin(label[outside], near[near > 0]).any())
    return True
