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
from anm_mj.sensing.pixel_state import BLOCK_PX, missing_blocks, valid_pixels
from anm_mj.types import FREE, Observation
from anm_mj.utils.native_functions import native_function

NEAREST_M = 0.25
"""Rays begin at this horizontal distance from the camera [m]: the robot's own body is free."""
MAX_WAITING = 40
"""Views kept until the next decision at most; a full rotation takes 36."""
SAMPLES_AT_ONCE = 12
"""NumPy follows rays by so many samples at a time."""


@dataclass(frozen=True)
class UnmeasuredView:
    """The rays of a view that measured nothing."""

    origin_m: Float64[np.ndarray, "3"]
    direction: Float64[np.ndarray, "n 3"]
    """In the world, of horizontal length 1."""


class UnmeasuredRays:
    """Collects the rays of views until the map holds these views, then finds what they looked into."""

    def __init__(self) -> None:
        """Start without any view."""
        self._waiting: deque[UnmeasuredView] = deque(maxlen=MAX_WAITING)

    def add(self, observation: Observation) -> None:
        """Note the directions in which a view measured nothing; none for a camera that says where it looked too far."""
        lost = missing_blocks(~valid_pixels(observation))
        if not lost.any():
            return
        middle = slice(BLOCK_PX // 2, None, BLOCK_PX)
        rows, cols = lost.shape
        in_camera = pixel_directions(observation.intrinsics)[middle, middle][:rows, :cols][lost]
        direction = in_camera @ observation.T_world_camera[:3, :3].T
        length = np.hypot(direction[:, 0], direction[:, 1])
        # Rays straight up or down meet no cell that any other ray meets.
        slanted = length > 0.1
        direction = direction[slanted] / length[slanted, None]
        if len(direction):
            self._waiting.append(UnmeasuredView(observation.T_world_camera[:3, 3].copy(), direction))

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
            cell, sample = first_closed(occupancy, rays, distance_m)
            ends = cell >= 0
            cells.append(cell[ends])
            distances.append(distance_m[sample[ends]])
        self._waiting.clear()
        return np.concatenate(cells), np.concatenate(distances)


def first_closed(
    occupancy: PooledOccupancy, rays: UnmeasuredView, distance_m: Float64[np.ndarray, " samples"]
) -> tuple[Int64[np.ndarray, " n"], Int64[np.ndarray, " n"]]:
    """The first cell along each ray that is not free, as a flat index, and its sample; -1 where all are free.

    In C++ (``native/gain_rays.h``) where the engine was built, else in NumPy, which gives the same. Steep rays end in
    the lowest or in the highest layer, as those of the gain do.

    Args:
        occupancy: the map.
        rays: of one view.
        distance_m: horizontal distance of the samples [m].
    """
    native = native_function("first_closed")
    if native is None:
        return numpy_first_closed(occupancy, rays, distance_m)
    cell, sample = (np.empty(len(rays.direction), np.int64) for _ in range(2))
    frame = np.array([*occupancy.origin_m, occupancy.cell_m, *_lowest_and_highest_m(occupancy)])
    native(occupancy.state, frame, rays.origin_m, rays.direction, distance_m, cell, sample)
    return cell, sample


def numpy_first_closed(
    occupancy: PooledOccupancy, rays: UnmeasuredView, distance_m: Float64[np.ndarray, " samples"]
) -> tuple[Int64[np.ndarray, " n"], Int64[np.ndarray, " n"]]:
    """The reference of :func:`first_closed`."""
    cell, sample = np.full((2, len(rays.direction)), -1)
    # Most rays end early, and their ends are not looked at.
    left = np.arange(len(rays.direction))
    for begin in range(0, len(distance_m), SAMPLES_AT_ONCE):
        here_m = distance_m[begin : begin + SAMPLES_AT_ONCE]
        x, y, z = (rays.origin_m[axis] + np.multiply.outer(rays.direction[left, axis], here_m) for axis in range(3))
        index = occupancy.flat_index_of(x, y, z.clip(*_lowest_and_highest_m(occupancy)))
        closed = occupancy.state.reshape(-1)[index] != FREE
        first, ends = closed.argmax(axis=1), closed.any(axis=1)
        cell[left[ends]] = index[ends, first[ends]]
        sample[left[ends]] = begin + first[ends]
        left = left[~ends]
    return cell, sample


def _lowest_and_highest_m(occupancy: PooledOccupancy) -> tuple[float, float]:
    """Middle of the lowest layer and of the highest one [m]."""
    low, high = occupancy.origin_m[2], occupancy.origin_m[2] + len(occupancy.state) * occupancy.cell_m
    return float(low + 0.5 * occupancy.cell_m), float(high - 0.5 * occupancy.cell_m)
