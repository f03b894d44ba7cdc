"""Pools a part of the occupancy grid to twice the voxel size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int, Int8, Int64

from anm_mj import _native
from anm_mj.planning.grid_windows import Window

POOL = 2
"""Voxels along the edge of a cell."""
KNOWN = 2
"""State of cells that are not free and where nothing new is looked for, beside those of voxels."""


@dataclass(frozen=True)
class PooledPart:
    """A part of the grid and where its cells go. Its outermost rows and columns are looked at and not written."""

    low: Int[np.ndarray, "3"]
    """Layer, row and column of its first voxel, which may lie outside of the grid: there all is unknown."""
    shape: Int[np.ndarray, "3"]
    """Layers, rows and columns of its cells."""
    floor: int
    """Which of its layers of cells holds the floor."""
    to: Int[np.ndarray, "3"]
    """Layer, row and column of the first cell that is written."""


def pool(
    state: Int8[np.ndarray, "layers rows cols"],
    part: PooledPart,
    cells: Int8[np.ndarray, "l r c"],
    num_free: Int64[np.ndarray, " l"],
    num_surface: Int64[np.ndarray, " l"],
) -> Window | None:
    """Pool a part of the grid again.

    Args:
        state: of all voxels.
        part: what is pooled.
        cells: what is written to.
        num_free: free cells of each layer; kept up.
        num_surface: occupied cells of each layer; kept up.

    Returns:
        Rows and columns in which cells have changed; None where none has.
    """
    low, shape, to = (np.ascontiguousarray(three, np.int64) for three in (part.low, part.shape, part.to))
    changed = _native.pool_window(state, low, shape, part.floor, cells, to, num_free, num_surface)
    return None if changed is None else (slice(*changed[:2]), slice(*changed[2:]))
