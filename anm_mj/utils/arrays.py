"""Arrays of grids: values at cells that may lie outside, numbers of cells, larger arrays around a smaller one, masks
with their neighbours, and rectangular windows.
"""

import numpy as np
from jaxtyping import Bool, Int, Int64, Shaped

Window = tuple[slice, slice]
"""Rows and columns of a rectangle of cells."""


def values_at(
    array: Shaped[np.ndarray, "..."], cells: Int[np.ndarray, "*n axes"], outside: float | np.generic
) -> Shaped[np.ndarray, "*n"]:
    """Values of an array at cells, given by their indices along its axes; for those that it lacks ``outside``, in the
    array's type.
    """
    inside = ((cells >= 0) & (cells < array.shape)).all(axis=-1)
    values = np.full(inside.shape, outside, array.dtype)
    values[inside] = array[tuple(cells[inside].T)]
    return values


def numbers_of(cells: Int64[np.ndarray, "n 3"]) -> Int64[np.ndarray, " n"]:
    """A number for each cell, different for different ones of indices from -2^20 to 2^20 - 1."""
    return (cells[:, 0] << 42) + (cells[:, 1] << 21) + cells[:, 2]


def embed(
    array: Shaped[np.ndarray, "..."], shape: tuple[int, ...], start: Int[np.ndarray, " axes"], fill: float | np.generic
) -> Shaped[np.ndarray, "..."]:
    """A larger array that contains a smaller, perhaps empty one from the index ``start`` on; ``fill`` elsewhere."""
    # np.pad does the same and takes several times as long.
    larger = np.full(shape, fill, array.dtype)
    larger[tuple(slice(int(a), int(a) + n) for a, n in zip(start, array.shape, strict=True))] = array
    return larger


def dilate_mask(mask: Bool[np.ndarray, "*cells"]) -> Bool[np.ndarray, "*cells"]:
    """A mask and its face neighbours along all axes."""
    near = mask.copy()
    for axis in range(mask.ndim):
        ahead, behind = ((slice(None),) * axis + (part,) for part in (slice(1, None), slice(None, -1)))
        near[ahead] |= mask[behind]
        near[behind] |= mask[ahead]
    return near


def clamp(first: Int[np.ndarray, "2"], last: Int[np.ndarray, "2"], shape: tuple[int, ...]) -> Window:
    """The window from ``[row, col]`` ``first`` up to, not including, ``last``, clamped to the grid's shape."""
    a, b = (slice(min(max(int(f), 0), n), min(max(int(e), 0), n)) for f, e, n in zip(first, last, shape, strict=True))
    return a, b


def bounds(mask: Bool[np.ndarray, "rows cols"], window: Window) -> list[Window]:
    """The bounding box of a mask over a window: one window, or none when the mask is empty."""
    rows, cols = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return []
    r, c = window[0].start, window[1].start
    return [(slice(r + int(rows[0]), r + int(rows[-1]) + 1), slice(c + int(cols[0]), c + int(cols[-1]) + 1))]


def union(windows: list[Window]) -> Window:
    """The smallest window that contains all of these."""
    a, b = (slice(min(w[k].start for w in windows), max(w[k].stop for w in windows)) for k in (0, 1))
    return a, b


def dilate(window: Window, cells: int, shape: tuple[int, ...]) -> Window:
    """A window extended by ``cells`` on all sides, clamped to the grid's shape."""
    a, b = (slice(max(s.start - cells, 0), min(s.stop + cells, n)) for s, n in zip(window, shape, strict=True))
    return a, b


def relative_to(inner: Window, outer: Window) -> Window:
    """``inner`` in the coordinates of ``outer``."""
    a, b = (slice(i.start - o.start, i.stop - o.start) for i, o in zip(inner, outer, strict=True))
    return a, b
