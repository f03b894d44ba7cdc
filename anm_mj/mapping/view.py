"""Where to sample the field to render a view: about the first occupied voxel along each ray."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Float32

from anm_mj.frames import pixel_directions
from anm_mj.mapping.occupancy import OccupancyGrid
from anm_mj.types import OCCUPIED, Intrinsics

_SAMPLES = 24
"""Samples per ray within two truncations of the voxel."""
_MAX_DEPTH_M = 12.0
"""Planar depth at which the search for a voxel ends [m]."""


def view_samples(
    occupancy: OccupancyGrid, intrinsics: Intrinsics, T_world_camera: Float[np.ndarray, "4 4"], truncation_m: float
) -> tuple[
    Float32[np.ndarray, "n 3"],
    Float32[np.ndarray, "n 3"],
    Float32[np.ndarray, "n samples"],
    Bool[np.ndarray, " pixels"],
]:
    """Rays that meet an occupied voxel, and the planar depths to sample along each.

    Args:
        occupancy: The grid to search.
        intrinsics: The camera.
        T_world_camera: Camera to world.
        truncation_m: Truncation distance of the field [m].

    Returns:
        Origins [m] and directions (planar depth 1) of the rays that hit, their sample depths [m], and which pixels
        they are, row by row.
    """
    directions = pixel_directions(intrinsics).reshape(-1, 3) @ T_world_camera[:3, :3].T
    origin = T_world_camera[:3, 3]
    found = np.full(len(directions), np.nan)
    searching = np.arange(len(directions))
    step = occupancy.config.voxel_m * 0.6
    for z in np.arange(step, _MAX_DEPTH_M, step):
        occupied = occupancy.state_at(origin + directions[searching] * z) == OCCUPIED
        found[searching[occupied]] = z
        searching = searching[~occupied]
        if not len(searching):
            break
    hit = np.isfinite(found)
    offsets = np.linspace(-truncation_m, 2.0 * truncation_m, _SAMPLES)
    z = np.maximum(found[hit][:, None] + offsets, 1e-3).astype(np.float32)
    rays = directions[hit].astype(np.float32)
    return np.broadcast_to(origin.astype(np.float32), rays.shape).copy(), rays, z, hit
