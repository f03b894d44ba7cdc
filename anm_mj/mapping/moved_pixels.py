"""Which pixels of a frame show something that moves, decided by what the occupancy grid knows, and what follows of it.

Space that was looked through often enough is surely free. What is measured there has come since, and so has what hangs
together with it in the image, unless the grid knows surface there (free space as evidence: Schmid et al., Dynablox,
RA-L 2023; growth in the image: Palazzolo et al., ReFusion, IROS 2019). No detector has to know what it is.

A pixel counts as moved only if all space that its depth may be too short by is free, too: by the noise learnt from the
images and by how unsure the pose is. Moved pixels mark no surface. They raise the log-odds of their voxels more slowly
than looking through lowers them, so that what stays becomes surface after a while. Where something moves, looking
through voxels counts as much as a hit: what was marked before it was known to move is freed.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Int64, UInt8

from anm_mj.mapping.depth_noise import EXACT_PER_M
from anm_mj.mapping.mapping_config import MovingConfig, OccupancyConfig
from anm_mj.mapping.occupancy_kernels import BLOCK, NOWHERE, VoxelArrays
from anm_mj.types import FREE, OCCUPIED, Observation

NOISE_REACH = 4.0
"""Depth may be too short by so many standard deviations."""
_HELD = 1
"""Log-odds of a voxel that is taken for an obstacle for now; less than those of any hit."""


class MovedVoxels:
    """Remembers where something moved lately, and what of it is taken for an obstacle."""

    def __init__(self, config: MovingConfig, occupancy: OccupancyConfig) -> None:
        self.config, self._occupancy = config, occupancy
        self._last: dict[tuple[int, int], int] = {}
        """Frame in which something moved in a column of blocks, by its x and y in blocks of the world."""
        self._newest: Int64[np.ndarray, "n 3"] = np.zeros((0, 3), np.int64)
        """Where something moved in the last frame that showed any, by x, y and z index."""
        self._held: Int64[np.ndarray, "m 3"] = self._newest

    def take(self, voxels: VoxelArrays, places: Int64[np.ndarray, "n 3"], frame: int) -> None:
        """Note that something moved in voxels, given by x, y and z index; what stays there becomes surface."""
        for x, y in np.unique(places[:, :2] // BLOCK, axis=0).tolist():
            self._last[x, y] = frame
        self._newest = np.unique(places, axis=0)
        _, cells = voxels.cells_of(self._newest)
        raised = np.minimum(voxels.log_odds[cells].astype(np.int16) + self.config.stay, self._occupancy.limit)
        # What nobody has looked through holds no evidence to be outweighed.
        known = voxels.log_odds[cells] < 0
        cells = tuple(axis[known] for axis in cells)
        voxels.log_odds[cells] = raised[known].astype(np.int8)
        layer, row, col = (axis[raised[known] >= 0] for axis in cells)
        voxels.log_odds[layer, row, col] = self._occupancy.hit
        voxels.state[layer, row, col] = OCCUPIED
        voxels.block_stamp[layer // BLOCK, row // BLOCK, col // BLOCK] = frame
        voxels.column_version[row // BLOCK, col // BLOCK] = frame

    def hold(self, voxels: VoxelArrays, frame: int) -> None:
        """Take what moved last for an obstacle; looking through it once frees it."""
        self._set(voxels, self._newest, frame, below=0, log_odds=_HELD, state=OCCUPIED)
        self._held = np.concatenate((self._held, self._newest))

    def release(self, voxels: VoxelArrays, frame: int) -> bool:
        """Take what was held for an obstacle for free space; whether any was left."""
        found = self._set(voxels, self._held, frame, below=_HELD, log_odds=-self.config.free_looks, state=FREE)
        self._held = self._held[:0]
        return found

    @staticmethod
    def _set(
        voxels: VoxelArrays, places: Int64[np.ndarray, "n 3"], frame: int, *, below: int, log_odds: int, state: int
    ) -> bool:
        """Set those of some voxels whose log-odds are ``below`` that or equal, and observed; whether there were any."""
        _, (layer, row, col) = voxels.cells_of(places)
        chosen = (voxels.log_odds[layer, row, col] <= below) & (voxels.state[layer, row, col] != state)
        layer, row, col = layer[chosen], row[chosen], col[chosen]
        voxels.log_odds[layer, row, col], voxels.state[layer, row, col] = log_odds, state
        voxels.column_version[row // BLOCK, col // BLOCK] = frame
        return bool(chosen.any())

    def heavy(self, voxels: VoxelArrays, frame: int) -> UInt8[np.ndarray, "block_rows block_cols"]:
        """Columns of a grid's blocks in which something moved in the last frames; empty for none."""
        oldest = frame - self.config.memory_frames
        self._last = {place: last for place, last in self._last.items() if last >= oldest}
        if not self._last:
            return NOWHERE
        found = np.zeros(voxels.column_version.shape, np.uint8)
        for x, y in self._last:
            row, col = y - int(voxels.corner[1]) // BLOCK, x - int(voxels.corner[0]) // BLOCK
            # A step leads into the next block.
            found[max(row - 1, 0) : row + 2, max(col - 1, 0) : col + 2] = 1
        return found


def depth_doubt(noise_per_m: float, observation: Observation, range_m: float) -> tuple[float, float]:
    """By how much a measured depth may be too short: a factor of its square [1/m], and a length [m].

    Args:
        noise_per_m: the sensor's, as :mod:`anm_mj.mapping.depth_noise` has it; infinite where nobody knows.
        observation: says how sure the pose is.
        range_m: depth at which its rotation counts [m].
    """
    noise = 0.0 if noise_per_m < EXACT_PER_M or not math.isfinite(noise_per_m) else noise_per_m
    pose_m = math.hypot(observation.position_deviation_m, observation.heading_deviation_rad * range_m)
    return NOISE_REACH * noise, NOISE_REACH * pose_m
