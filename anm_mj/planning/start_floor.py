"""The floor about the start, which no camera sees from there: how far out it counts as free."""

import logging
import math

import numpy as np
from jaxtyping import Float, Int

from anm_mj.frames import world_to_cell
from anm_mj.planning.field_of_view import FieldOfView
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.types import Footprint, OccupancyGrid
from anm_mj.utils.arrays import values_at

_logger = logging.getLogger(__name__)

BLIND_SLACK_M = 0.15
"""What a camera at the start cannot see counts as free this much farther than by its geometry [m]: carving is
cautious."""
MAX_GAP_M = 0.5
"""A ring of unknown floor about the start that is no wider than this counts as free [m]."""
_DIRECTIONS, _LEAST_DIRECTIONS, _SHARE = 72, 8, 0.75
"""Directions that it is looked for in, in how many of them the floor must be seen, and the share of these in which it
is to be bridged."""


def blind_radius_m(camera: FieldOfView, footprint: Footprint, config: PlanningConfig) -> float:
    """Up to where the camera cannot see enough of the columns about the start to tell that they are free [m]."""
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
    known: Int[np.ndarray, "rows cols"], grid: OccupancyGrid, start_xy_m: Float[np.ndarray, "2"], radius_m: float
) -> float:
    """Up to where the floor at the start counts as free, so that no ring of unknown floor encloses the robot [m].

    A noisy sensor sees the nearest floor later than the camera's geometry tells. The disc reaches as far out as the
    floor is seen free in three quarters of the directions in which nothing stands before, and at least ``radius_m``.
    ``known`` is 1 in columns of the grid that were seen free, 2 in occupied ones, 0 in others.
    """
    cell = grid.resolution_m
    angle = np.arange(_DIRECTIONS) * math.tau / _DIRECTIONS
    reach_m = np.arange(0.0, radius_m + MAX_GAP_M + cell / 2, cell)
    place = start_xy_m + reach_m[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    seen = values_at(known, world_to_cell(place, grid.origin_m[:2], cell), 0)
    seen[(seen == 1) & (reach_m < radius_m)[:, None]] = 0
    first = seen.astype(bool).argmax(axis=0)
    free_m = reach_m[first][np.take_along_axis(seen, first[None], axis=0)[0] == 1]
    if len(free_m) < _LEAST_DIRECTIONS:
        return radius_m
    return float(np.quantile(free_m, _SHARE, method="higher"))
