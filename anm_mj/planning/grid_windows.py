"""Parts of a grid: rectangles that an update has to look at, and what lies next to something."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int

Window = tuple[slice, slice]
"""Rows and columns of a part."""


def clipped(first: Int[np.ndarray, 2], last: Int[np.ndarray, 2], shape: tuple[int, ...]) -> Window:
    """The part from one row and column up to before others, as far as the map goes."""
    a, b = (slice(min(max(int(f), 0), n), min(max(int(e), 0), n)) for f, e, n in zip(first, last, shape, strict=True))
    return a, b


def bounds(mask: Bool[np.ndarray, "rows cols"], window: Window) -> list[Window]:
    """The smallest part of a window that holds all of a mask over it: at most one, none when the mask is empty."""
    rows, cols = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return []
    r, c = window[0].start, window[1].start
    return [(slice(r + int(rows[0]), r + int(rows[-1]) + 1), slice(c + int(cols[0]), c + int(cols[-1]) + 1))]


def hull(windows: list[Window]) -> Window:
    """The smallest window that holds some others."""
    a, b = (slice(min(w[k].start for w in windows), max(w[k].stop for w in windows)) for k in (0, 1))
    return a, b


def grown(window: Window, cells: int, shape: tuple[int, ...]) -> Window:
    """A window with so many more cells on all sides, as far as there are any."""
    a, b = (slice(max(s.start - cells, 0), min(s.stop + cells, n)) for s, n in zip(window, shape, strict=True))
    return a, b


def relative_to(inner: Window, outer: Window) -> Window:
    """A window in the cells of another one."""
    a, b = (slice(i.start - o.start, i.stop - o.start) for i, o in zip(inner, outer, strict=True))
    return a, b


def next_to(mask: Bool[np.ndarray, "*cells"]) -> Bool[np.ndarray, "*cells"]:
    """Cells in a mask or with a face neighbour in it."""
    near = mask.copy()
    for axis in range(mask.ndim):
        ahead, behind = ((slice(None),) * axis + (part,) for part in (slice(1, None), slice(None, -1)))
        near[ahead] |= mask[behind]
        near[behind] |= mask[ahead]
    return near
