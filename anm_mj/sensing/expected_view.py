"""What the map expects a camera to measure; a frame without any depth is held against it."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from anm_mj.types import FREE, OCCUPIED, UNKNOWN, Observation, OccupancyGrid
from anm_mj.utils.arrays import values_at

NEAR_M = 0.5
"""Surface nearer than this is not expected to be measured [m]: depth cameras need some distance."""
RAYS_PER_SIDE = 16

GridQuery = Callable[[Float[np.ndarray, "2"], float], OccupancyGrid]
"""A place in the plane and a radius [m] to the occupancy there."""


class ExpectedView(NamedTuple):
    """What the map says about a view."""

    share: float
    """Of the view in which it has surface that a camera measures."""
    within_m: float
    """Planar depth up to which surface was looked for [m]."""


def expected_view(observation: Observation, within_m: float, grid_at: GridQuery) -> ExpectedView:
    """How much of a view shows surface that the map knows. Rays end at the first voxel that was not seen free; what is
    unknown or nearer than ``NEAR_M`` is not expected. Of the frame only camera and pose count; ``within_m`` is finite,
    the planar depth up to which the camera measures surely; ``grid_at`` gives the occupancy before this frame.
    """
    k, T_world_camera = observation.intrinsics, observation.T_world_camera
    centre_m = T_world_camera[:3, 3]
    grid = grid_at(centre_m[:2], within_m)
    u, v = ((np.arange(RAYS_PER_SIDE) + 0.5) / RAYS_PER_SIDE * n for n in (k.width, k.height))
    x, y = np.meshgrid((u - k.cx) / k.fx, (v - k.cy) / k.fy)
    rays = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1) @ T_world_camera[:3, :3].T
    depths_m = np.arange(0.0, within_m, 0.5 * grid.resolution_m)
    points_m = centre_m + rays[:, None] * depths_m[:, None]
    cells = np.floor((points_m - grid.origin_m) / grid.resolution_m).astype(np.int64)[..., ::-1]
    state = values_at(grid.state, cells, UNKNOWN)
    ends = state != FREE
    first = ends.argmax(axis=1)
    hit = ends.any(axis=1) & (state[np.arange(len(state)), first] == OCCUPIED)
    return ExpectedView(float((hit & (depths_m[first] >= NEAR_M)).mean()), within_m)
