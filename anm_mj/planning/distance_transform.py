"""Exact Euclidean distance transform up to a cap, at a fraction of the cost of a full one.

In C++ (``native/plane_maps.h``) where the engine was built, else in NumPy, which gives the same.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32, UInt16

from anm_mj.utils.native_functions import native_function

LARGEST_NATIVE_CAP = 181
"""Larger caps are left to NumPy [cells]."""


def capped_distance_cells(free: Bool[np.ndarray, "rows cols"], cap_cells: int) -> Float32[np.ndarray, "rows cols"]:
    """Distance from each cell's centre to the nearest cell that is not free, at most ``cap_cells`` [cells].

    Cells outside of the grid count as free. Source: Saito and Toriwaki, Pattern Recognition 27(11), 1994: squared
    distances along rows, then the lower envelope along columns, which the cap makes a fixed number of minima.
    """
    native = native_function("capped_distances") if cap_cells <= LARGEST_NATIVE_CAP else None
    if native is None:
        return numpy_capped_distance_cells(free, cap_cells)
    return native(np.ascontiguousarray(free).view(np.uint8), cap_cells)


def numpy_capped_distance_cells(
    free: Bool[np.ndarray, "rows cols"], cap_cells: int
) -> Float32[np.ndarray, "rows cols"]:
    """The reference of :func:`capped_distance_cells`."""
    # The smaller type holds the sum of two squares up to 181 cells, and takes half of the time.
    whole = np.uint16 if 2 * cap_cells**2 <= np.iinfo(np.uint16).max else np.uint32
    squared = np.square(_along_rows(free, cap_cells), dtype=whole)
    nearest = squared.copy()
    shifted = np.empty_like(squared)
    for d in range(1, min(cap_cells, len(free))):
        np.add(squared, whole(d * d), out=shifted)
        np.minimum(nearest[:-d], shifted[d:], out=nearest[:-d])
        np.minimum(nearest[d:], shifted[:-d], out=nearest[d:])
    return np.sqrt(nearest, dtype=np.float32)


def _along_rows(free: Bool[np.ndarray, "rows cols"], cap_cells: int) -> UInt16[np.ndarray, "rows cols"]:
    """Distance to the nearest cell of the same row that is not free, capped [cells]."""
    distance = np.where(free, np.uint16(cap_cells), np.uint16(0))
    step = 1
    while step < min(cap_cells, free.shape[1]):
        # Distances that were exact below one step are exact below two.
        farther = distance + np.uint16(step)
        np.minimum(distance[:, :-step], farther[:, step:], out=distance[:, :-step])
        np.minimum(distance[:, step:], farther[:, :-step], out=distance[:, step:])
        step *= 2
    return distance
