"""Pools a part of the occupancy grid to twice the voxel size.

In C++ (``native/pooled_cells.h``) where the engine was built, else in NumPy, which gives the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int, Int8, Int64

from anm_mj.planning.grid_windows import Window, bounds
from anm_mj.types import FREE, OCCUPIED, UNKNOWN
from anm_mj.utils.arrays import dilate_mask
from anm_mj.utils.native_functions import native_function

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
    native = native_function("pool_window")
    if native is None:
        return numpy_pool(state, part, cells, num_free, num_surface)
    low, shape, to = (np.ascontiguousarray(three, np.int64) for three in (part.low, part.shape, part.to))
    changed = native(state, low, shape, part.floor, cells, to, num_free, num_surface)
    return None if changed is None else (slice(*changed[:2]), slice(*changed[2:]))


def numpy_pool(
    state: Int8[np.ndarray, "layers rows cols"],
    part: PooledPart,
    cells: Int8[np.ndarray, "l r c"],
    num_free: Int64[np.ndarray, " l"],
    num_surface: Int64[np.ndarray, " l"],
) -> Window | None:
    """The reference of :func:`pool`."""
    low, high = part.low, part.low + POOL * part.shape
    inside = tuple(slice(max(a, 0), min(b, n)) for a, b, n in zip(low, high, state.shape, strict=True))
    voxels = state[inside]
    pad = [(max(-int(a), 0), max(int(b - n), 0)) for a, b, n in zip(low, high, state.shape, strict=True)]
    if any(max(p) for p in pad):
        voxels = np.pad(voxels, pad, constant_values=UNKNOWN)
    pooled, partly = _pooled(voxels)
    pooled[partly & dilate_mask(pooled == OCCUPIED)] = KNOWN
    pooled[:, _without_floor(pooled, part.floor)] = KNOWN
    pooled = pooled[:, 1:-1, 1:-1]
    where = tuple(slice(int(a), int(a + b)) for a, b in zip(part.to, pooled.shape, strict=True))
    changed = bounds((pooled != cells[where]).any(axis=0), (where[1], where[2]))
    if not changed:
        return None
    for counts, counted in ((num_free, FREE), (num_surface, OCCUPIED)):
        counts[where[0]] += np.count_nonzero(pooled == counted, axis=(1, 2))
        counts[where[0]] -= np.count_nonzero(cells[where] == counted, axis=(1, 2))
    cells[where] = pooled
    return changed[0]


def _without_floor(state: Int8[np.ndarray, "layers rows cols"], floor: int) -> Bool[np.ndarray, "rows cols"]:
    """Columns that are seen free through the floor's layer and the one below: there the building has ended."""
    if not 1 <= floor < len(state):
        return np.zeros(state.shape[1:], bool)
    return (state[floor] == FREE) & (state[floor - 1] == FREE)


def _pooled(
    state: Int8[np.ndarray, "layers rows cols"],
) -> tuple[Int8[np.ndarray, "l r c"], Bool[np.ndarray, "l r c"]]:
    """State of cells of 2 x 2 x 2 voxels, and which of the unknown ones are not unknown throughout."""
    # Of -1, 0 and 1 this leaves 17, 0 and 1, so that one sum holds the unknown in its upper four bits and all that is
    # not free in its lower four.
    total = state.view(np.uint8) & np.uint8(17)
    total = total[0::2] + total[1::2]
    total = total[:, 0::2] + total[:, 1::2]
    # Neighbours in a row as the two halves of one number: no sum exceeds a byte.
    pairs = np.ascontiguousarray(total).view(np.uint16)
    total = (pairs + (pairs >> 8)).astype(np.uint8)
    num_unknown = total >> 4
    occupied = (total & np.uint8(15)) > num_unknown
    unknown = (num_unknown >= POOL**3 // 2) & ~occupied
    pooled = occupied.astype(np.int8)
    pooled[unknown] = UNKNOWN
    return pooled, unknown & (num_unknown < POOL**3)
