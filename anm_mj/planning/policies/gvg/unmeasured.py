"""Directions in which the camera measured nothing, and the unknown cells that it looked into there.

A camera that cannot tell a lost pixel from one that looked too far leaves the sky over an open building, dark surface
and whatever lies beyond its range unknown for ever. Rays to such cells would expect surface at every new place. They
were looked at, though: that the camera measured nothing there is all that such a view has to tell.
"""

import math
from collections import deque

import numpy as np
from jaxtyping import Bool, Float, Float64, Int

from anm_mj import _native
from anm_mj.frames import pixel_directions
from anm_mj.planning.policies.gvg.pooled_occupancy import PooledOccupancy
from anm_mj.planning.policies.gvg.views import NUM_AZIMUTHS
from anm_mj.sensing.pixel_state import BLOCK_PX, missing_blocks, moved_pixels, valid_pixels
from anm_mj.types import Observation

NEAREST_M = 0.25
"""Rays begin at this horizontal distance from the camera [m]: the robot's own body is free."""
MAX_WAITING = 40
"""Views kept until the next decision at most; a full rotation takes 36."""


def hidden_sectors(observation: Observation, aside_rad: float) -> Bool[np.ndarray, " azimuths"] | None:
    """The sectors of heading in which something that moves hides what is behind it from a camera that looks
    ``aside_rad`` beside the heading; None if nothing does.
    """
    columns = np.count_nonzero(moved_pixels(observation), axis=0) >= BLOCK_PX
    if not columns.any():
        return None
    middle = pixel_directions(observation.intrinsics)[observation.intrinsics.height // 2, columns]
    direction = middle @ observation.T_world_camera[:3, :3].T
    heading = np.arctan2(direction[:, 1], direction[:, 0]) - aside_rad
    sector = np.rint(heading * (NUM_AZIMUTHS / math.tau)).astype(int)
    hidden = np.zeros(NUM_AZIMUTHS, bool)
    hidden[sector % NUM_AZIMUTHS] = True
    return hidden


class UnmeasuredRays:
    """Collects the rays of views until the map holds these views, then finds what they looked into."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "n 3"]]] = deque(maxlen=MAX_WAITING)
        """Where each view looked from and its rays that measured nothing, of horizontal length 1, in the world [m]."""

    def add(self, observation: Observation) -> None:
        """Note the directions in which a view measured nothing; none for a camera that says where it looked too far."""
        # What somebody hides was not looked at.
        lost = missing_blocks(~(valid_pixels(observation) | moved_pixels(observation)))
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
            self._waiting.append((observation.T_world_camera[:3, 3].copy(), direction))

    def take(self, occupancy: PooledOccupancy, range_m: float) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """The first cell that is not free along each of the collected rays, which are forgotten: flat indices into the
        occupancy, and horizontal distances [m].

        The occupancy holds the views whose rays were added; ``range_m`` is the horizontal length of the rays [m].
        """
        cells, distances = [np.zeros(0, np.int64)], [np.zeros(0)]
        distance_m = np.arange(NEAREST_M, range_m, occupancy.cell_m)
        low_m, cell_m = float(occupancy.origin_m[2]), occupancy.cell_m
        # Steep rays end in the middle of the lowest layer or of the highest one, as those of the gain do.
        ends_m = low_m + 0.5 * cell_m, low_m + len(occupancy.state) * cell_m - 0.5 * cell_m
        frame = np.array([*occupancy.origin_m, cell_m, *ends_m])
        for origin_m, direction in self._waiting:
            cell, sample = (np.empty(len(direction), np.int64) for _ in range(2))
            _native.first_closed(occupancy.state, frame, origin_m, direction, distance_m, cell, sample)
            ends = cell >= 0
            cells.append(cell[ends])
            distances.append(distance_m[sample[ends]])
        self._waiting.clear()
        return np.concatenate(cells), np.concatenate(distances)
