"""The occupancy as rays for expected gain see it: pooled to twice the voxel size, padded, kept up where it changed.

A cell is occupied where any of its voxels is, else unknown where half of them are, else free. Cautious carving leaves
an unseen skin on surfaces; what is partly unknown next to occupied therefore counts as known. Where there is no floor,
as beyond an open door to the outside, nothing is looked for: such columns count as known too. Around the grid lies a
rim of unknown, as wide as rays are long, so that no ray ever leaves the array.
"""

import math

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int8

from anm_mj import _native
from anm_mj.types import UNKNOWN, OccupancyGrid
from anm_mj.utils.arrays import Window, embed

POOL = 2
"""Voxels along the edge of a cell."""
KNOWN = 2
"""State of a cell that holds no new surface, without being free."""
BLOCK = 32
"""The grid grows by multiples of this many cells, so that it seldom does."""
LOWEST_M = 0.2
"""Nothing is looked for deeper below the floor than this [m]."""
USUAL_SHARE = 0.02
"""Layers of rooms hold at least this share of surface; those above rooms without a ceiling hold next to none."""


class PooledOccupancy:
    """Cells ``[layer, row, col]``: free, occupied, unknown, or ``KNOWN``."""

    def __init__(self, rim_m: float) -> None:
        """Start empty; the rim of unknown around what was observed is this wide [m]."""
        self.rim_m = rim_m
        self.cell_m = 0.0
        self.origin_m = np.zeros(3)
        """World x, y, z of the outer corner of cell [0, 0, 0]."""
        shape = (0, 0, 0)
        self.state: Int8[np.ndarray, "layers rows cols"] = np.zeros(shape, np.int8)
        self.tried_from_m: Float32[np.ndarray, "layers rows cols"] = np.zeros(shape, np.float32)
        """Nearest distance from which a view had each cell in sight and left it unknown; +inf where none had."""
        self.layer_share: Float32[np.ndarray, " layers"] = np.zeros(0, np.float32)
        """How likely it is that what is unknown in a layer holds surface: from how much of the known part does."""
        self._num_free = np.zeros(0, np.int64)
        self._num_surface = np.zeros(0, np.int64)
        self.epoch = 0
        """Changes whenever the array does, so that flat indices into it are no longer valid."""

    @property
    def seen_m2(self) -> float:
        """How much surface was seen, each cell counting with one face [m2]: how far exploration is."""
        return float(self._num_surface.sum()) * self.cell_m**2

    def update(
        self, grid: OccupancyGrid, window: Window | None
    ) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]] | None:
        """Pool the cells again of a window in which voxels may have changed since the last update; None for none.
        Returns the corners of the part in which cells have changed [m]; None when none has.
        """
        self._cover(grid)
        if window is None:
            return None
        rows, cols = window
        offset = np.rint((grid.origin_m - self.origin_m) / grid.resolution_m).astype(int)[::-1]
        shape = np.array(grid.state.shape)
        # No ray goes below the floor.
        floor = max(grid.layer_of(-LOWEST_M), 0)
        # Whole cells only: their first voxel has an even index from this grid's own origin. What borders on surface
        # counts as known: to know that, one cell more is written on all sides and another one looked at.
        low, high = np.array([floor, rows.start, cols.start]), np.array([shape[0], rows.stop, cols.stop])
        low = low - (low + offset) % POOL - np.array([0, 2 * POOL, 2 * POOL])
        high = high + (high + offset) % POOL + np.array([0, 2 * POOL, 2 * POOL])
        to = (low + offset) // POOL + np.array([0, 1, 1])
        floor_layer = math.floor(-self.origin_m[2] / self.cell_m) - int(to[0])
        low, size, to = (np.ascontiguousarray(three, np.int64) for three in (low, (high - low) // POOL, to))
        counts = self._num_free, self._num_surface
        changed = _native.pool_window(grid.state, low, size, floor_layer, self.state, to, *counts)
        if changed is None:
            return None
        share = self._num_surface / np.maximum(self._num_free + self._num_surface, 1)
        self.layer_share[:] = np.where(self._num_free > 0, np.minimum(share / USUAL_SHARE, 1.0), 1.0)
        first_row, last_row, first_col, last_col = changed
        low, high = np.array([first_col, first_row]), np.array([last_col, last_row])
        return self.origin_m[:2] + low * self.cell_m, self.origin_m[:2] + high * self.cell_m

    def contains(self, xyz_m: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Which world points lie inside."""
        low, high = self.origin_m, self.origin_m + np.array(self.state.shape[::-1]) * self.cell_m
        return np.all((xyz_m >= low) & (xyz_m < high), axis=1)

    def flat_index(self, xyz_m: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
        """Index into the raveled arrays of the cells that hold world points, which must lie inside."""
        col, row, layer = np.floor((xyz_m - self.origin_m) / self.cell_m).astype(np.int64).T
        _, rows, cols = self.state.shape
        return (layer * rows + row) * cols + col

    def centres(self, flat: Int[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """World x, y, z of cells given by their index into the raveled arrays [m]."""
        layer, row, col = np.unravel_index(flat, self.state.shape)
        return self.origin_m + (np.stack([col, row, layer], axis=1) + 0.5) * self.cell_m

    def _cover(self, grid: OccupancyGrid) -> None:
        """Make room for all of ``grid`` and the rim."""
        cell = POOL * grid.resolution_m
        if not self.cell_m:
            self.cell_m = cell
            self.origin_m = grid.origin_m.astype(float)
        low = np.floor((grid.origin_m - self.origin_m) / cell + 1e-6).astype(int)
        high = np.ceil(
            (grid.origin_m + np.array(grid.state.shape[::-1]) * grid.resolution_m - self.origin_m) / cell - 1e-6
        )
        rim = math.ceil(self.rim_m / cell) + 1
        low -= np.array([rim, rim, 0])
        high = high.astype(int) + np.array([rim, rim, 0])
        shape = np.array(self.state.shape)[::-1]
        if shape.all() and (low >= 0).all() and (high <= shape).all():
            return
        block = np.array([BLOCK, BLOCK, 1])
        new_low, new_high = np.floor_divide(low, block) * block, -np.floor_divide(-high, block) * block
        if shape.all():
            new_low, new_high = np.minimum(new_low, 0), np.maximum(new_high, shape)
        new_shape = tuple((new_high - new_low)[::-1].tolist())
        for name, fill in (("state", UNKNOWN), ("tried_from_m", np.inf), ("_num_free", 0), ("_num_surface", 0)):
            old = getattr(self, name)
            setattr(self, name, embed(old, new_shape[: old.ndim], -new_low[::-1][: old.ndim], fill))
        self.layer_share = np.ones(new_shape[0], np.float32)
        self.origin_m = self.origin_m + new_low * cell
        self.epoch += 1
