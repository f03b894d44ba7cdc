"""Directions in which the camera measured nothing, and the unknown cells that it looked into there.

A camera that cannot tell a lost pixel from one that looked too far leaves the sky over an open building, dark surface
and whatever lies beyond its range unknown for ever. Rays to such cells would expect surface at every place anew. They
were looked at, though: that the camera measured nothing there is all that such a view has to tell.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int, Int64

from anm_mj.frames import pixel_directions
from anm_mj.planning.policies.gvg.pooled_occupancy import PooledOccupancy
from anm_mj.types import FREE, Observation

BLOCK_PX = 8
"""Pixels are judged in squares of this edge [px]: single ones are lost at every edge of things."""
MISSING_SHARE = 0.75
"""At least this share of a square must have measured nothing."""
NEAREST_M = 0.25
"""Rays begin at this horizontal distance from the camera [m]: the robot's own body is free."""
MAX_WAITING = 40
"""Views kept until the next decision at most; a full rotation takes 36."""
SAMPLES_AT_ONCE = 12
"""Rays are followed by so many samples at a time."""


@dataclass(frozen=True)
class _Rays:
    """The rays of a view that measured nothing."""

    origin_m: Float64[np.ndarray, "3"]
    direction: Float64[np.ndarray, "n 3"]
    """In the world, of horizontal length 1."""


class UnmeasuredRays:
    """Collects the rays of views until the map holds these views, then finds what they looked into."""

    def __init__(self) -> None:
        """Start without any view."""
        self._waiting: deque[_Rays] = deque(maxlen=MAX_WAITING)

    def add(self, observation: Observation) -> None:
        """Note the directions in which a view measured nothing; none for a camera that says where it looked too far."""
        missing = np.isnan(observation.depth_m)
        if not missing.any():
            return
        rows, cols = (n // BLOCK_PX for n in missing.shape)
        squares = missing[: rows * BLOCK_PX, : cols * BLOCK_PX].reshape(rows, BLOCK_PX, cols, BLOCK_PX)
        lost = squares.mean(axis=(1, 3)) >= MISSING_SHARE
        middle = slice(BLOCK_PX // 2, None, BLOCK_PX)
        in_camera = pixel_directions(observation.intrinsics)[middle, middle][:rows, :cols][lost]
        direction = in_camera @ observation.T_world_camera[:3, :3].T
        length = np.hypot(direction[:, 0], direction[:, 1])
        # Rays straight up or down meet no cell that any other ray meets.
        slanted = length > 0.1
        direction = direction[slanted] / length[slanted, None]
        if len(direction):
            self._waiting.append(_Rays(observation.T_world_camera[:3, 3].copy(), direction))

    def take(self, occupancy: PooledOccupancy, range_m: float) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """The first cell that is not free along each of the collected rays, which are forgotten.

        Args:
            occupancy: the map, with the views whose rays were added.
            range_m: horizontal length of the rays [m].

        Returns:
            Flat indices into the occupancy, and horizontal distances [m].
        """
        cells, distances = [np.zeros(0, np.int64)], [np.zeros(0)]
        distance_m = np.arange(NEAREST_M, range_m, occupancy.cell_m)
        for rays in self._waiting:
            # Most rays end early, and their ends are not looked at.
            direction = rays.direction
            for begin in range(0, len(distance_m), SAMPLES_AT_ONCE):
                here_m = distance_m[begin : begin + SAMPLES_AT_ONCE]
                index = _cells_along(occupancy, rays.origin_m, direction, here_m)
                closed = occupancy.state.reshape(-1)[index] != FREE
                first, ends = closed.argmax(axis=1), closed.any(axis=1)
                cells.append(index[ends, first[ends]])
                distances.append(here_m[first[ends]])
                direction = direction[~ends]
        self._waiting.clear()
        return np.concatenate(cells), np.concatenate(distances)


def _cells_along(
    occupancy: PooledOccupancy,
    origin_m: Float64[np.ndarray, "3"],
    direction: Float64[np.ndarray, "n 3"],
    distance_m: Float64[np.ndarray, " samples"],
) -> Int64[np.ndarray, "n samples"]:
    """Flat indices of the cells at some distances along rays.

    Steep rays end in the lowest or in the highest layer, as those of the gain do.
    """
    low, high = occupancy.origin_m[2], occupancy.origin_m[2] + len(occupancy.state) * occupancy.cell_m
    x, y, z = (origin_m[axis] + np.multiply.outer(direction[:, axis], distance_m) for axis in range(3))
    z = z.clip(low + 0.5 * occupancy.cell_m, high - 0.5 * occupancy.cell_m)
    return occupancy.flat_index_of(x, y, z)
