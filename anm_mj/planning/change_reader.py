"""Which part of the occupancy grid a reader has to read again."""

import numpy as np
from jaxtyping import Float, Int32

from anm_mj.errors import PlanError
from anm_mj.types import OccupancyGrid
from anm_mj.utils.arrays import Window, bounds, clamp, embed

NOTHING_OBSERVED = "The map holds nothing yet; give it and the policy an observation before asking for a plan."
"""What a policy says whose map is empty."""


class ChangeReader:
    """Keeps, for one reader of an occupancy grid, the version at which it last read each block of columns."""

    def __init__(self) -> None:
        """Start with nothing read; blocks of version 0 never changed."""
        self._read: Int32[np.ndarray, "block_rows block_cols"] = np.zeros((0, 0), np.int32)
        self._origin_xy_m = np.zeros(2)

    def take(self, grid: OccupancyGrid, box_xy_m: Float[np.ndarray, "2 2"] | None = None) -> Window | None:
        """The smallest window with all blocks that changed since the reader took them; it takes them now. Returns rows
        and columns; None when nothing has changed. The whole grid where nobody keeps track of changes.

        The grid is always the same one, as it grows. Blocks that do not touch a box, given by its lower and upper
        corner in the world [m], are left for later. Raises PlanError if the grid is empty.
        """
        if not grid.state.size:
            raise PlanError(NOTHING_OBSERVED)
        num_rows, num_cols = grid.state.shape[1:]
        if grid.column_version is None:
            return slice(0, num_rows), slice(0, num_cols)
        size = num_rows // len(grid.column_version)
        block_m, shape = size * grid.resolution_m, grid.column_version.shape
        if self._read.shape != shape:
            # The grid has grown.
            origin_xy_m = grid.origin_m[:2].astype(float)
            start = np.rint((self._origin_xy_m - origin_xy_m) / block_m).astype(int)[::-1]
            self._read, self._origin_xy_m = embed(self._read, shape, start, 0), origin_xy_m
        changed = grid.column_version > self._read
        if box_xy_m is not None:
            low, high = ((box_xy_m - self._origin_xy_m) / block_m)[:, ::-1]
            rows, cols = clamp(np.floor(low).astype(int), np.ceil(high).astype(int), changed.shape)
            near = np.zeros(changed.shape, bool)
            near[rows, cols] = True
            changed &= near
        self._read[changed] = grid.version
        for rows, cols in bounds(changed, (slice(0, len(changed)), slice(0, changed.shape[1]))):
            return slice(size * rows.start, size * rows.stop), slice(size * cols.start, size * cols.stop)
        return None
