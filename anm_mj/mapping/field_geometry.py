"""Free and occupied space as the neural field has it, wherever something was observed.

The occupancy grid knows what has been observed; the field knows where the surface is. A grid of raw depth puts an
obstacle wherever noise ever put a pixel, while the field averages the noise of all views. So every voxel that holds a
hit, and every observed voxel beside one, is read from the field: it is occupied where the surface passes through it or
before it. What no depth ever hit stays free or unknown, because a field extrapolates any sign it likes there.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Int8, Int32, Int64

from anm_mj.mapping.occupancy import BLOCK, OccupancyGrid
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, SdfQuery, VoxelGrid
from anm_mj.utils.arrays import dilate_mask, embed

SURFACE_SHARE = 0.5
"""A voxel is occupied where the signed distance at its centre is at most this share of its edge."""


class FieldGeometry:
    """Keeps the states of all observed voxels in step with the field, block by block, where frames came in."""

    def __init__(self, occupancy: OccupancyGrid) -> None:
        """Start with nothing read.

        Args:
            occupancy: what has been observed.
        """
        self._occupancy = occupancy
        self._corner: Int64[np.ndarray, "3"] = np.zeros(3, np.int64)
        self._state: Int8[np.ndarray, "layers rows cols"] = np.zeros((0, 0, 0), np.int8)
        self._column_version: Int32[np.ndarray, "block_rows block_cols"] = np.zeros((0, 0), np.int32)
        self._read_frame = 0

    def grid(self, sdf_m: SdfQuery) -> VoxelGrid:
        """Free, occupied and unknown space as of now.

        Args:
            sdf_m: signed distance at world points (N, 3) [m], positive in free space.
        """
        raw = self._occupancy.grid
        self._follow_growth(raw)
        if self._read_frame < raw.version:
            self._read(raw, sdf_m)
            self._read_frame = raw.version
        return VoxelGrid(
            self._state, raw.seen_range_m, raw.origin_m, raw.resolution_m, raw.version, self._column_version
        )

    def _read(self, raw: VoxelGrid, sdf_m: SdfQuery) -> None:
        """Read the blocks again that any frame since the last reading changed or had a hit in."""
        assert raw.column_version is not None  # The occupancy grid keeps track.
        changed_columns = raw.column_version > self._read_frame
        blocks = (self._occupancy.block_stamp > self._read_frame) | changed_columns
        state = _in_blocks(raw.state)[blocks]
        beside = dilate_mask(state == OCCUPIED, first_axis=1) & (state != UNKNOWN)
        block, layer, row, col = np.nonzero(beside)
        corner = np.argwhere(blocks)[block] * BLOCK + np.stack([layer, row, col], axis=1)
        points_m = (corner[:, ::-1] + self._corner) * raw.resolution_m
        solid = sdf_m(points_m.astype(float)) <= SURFACE_SHARE * raw.resolution_m
        state[block, layer, row, col] = np.where(solid, np.int8(OCCUPIED), np.int8(FREE))
        view = _in_blocks(self._state)
        moved = (view[blocks] != state).any(axis=(1, 2, 3))
        view[blocks] = state
        columns = changed_columns.copy()
        rows_cols = np.argwhere(blocks)[moved][:, 1:]
        columns[rows_cols[:, 0], rows_cols[:, 1]] = True
        self._column_version[columns] = raw.version

    def _follow_growth(self, raw: VoxelGrid) -> None:
        """Keep the states aligned with a grid that has grown."""
        if self._state.shape == raw.state.shape:
            return
        corner = self._occupancy.corner
        start = (self._corner - corner)[::-1] if self._state.size else np.zeros(3, np.int64)
        self._state = embed(self._state, raw.state.shape, start, UNKNOWN)
        shape = tuple(n // BLOCK for n in raw.state.shape[1:])
        self._column_version = embed(self._column_version, shape, start[1:] // BLOCK, 0)
        self._corner = corner.copy()


def _in_blocks(state: Int8[np.ndarray, "layers rows cols"]) -> Int8[np.ndarray, "bl br bc b b b"]:
    """A view of voxels by block: ``[block layer, block row, block col, layer, row, col]``."""
    layers, rows, cols = (n // BLOCK for n in state.shape)
    return state.reshape(layers, BLOCK, rows, BLOCK, cols, BLOCK).transpose(0, 2, 4, 1, 3, 5)
