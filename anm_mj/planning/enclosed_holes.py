"""Small parts of a map of the plane that hang together.

In C++ (``native/plane_maps.h``) where the engine was built, else by SciPy, which gives the same.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool
from scipy import ndimage

from anm_mj.utils.native_functions import native_function


def enclosed_holes(unknown: Bool[np.ndarray, "rows cols"], max_cells: float) -> Bool[np.ndarray, "rows cols"]:
    """The cells of parts of a mask, connected by sides, that have no more than ``max_cells``."""
    native = native_function("small_components")
    if native is None:
        return scipy_enclosed_holes(unknown, max_cells)
    holes = np.zeros(unknown.shape, bool)
    native(np.ascontiguousarray(unknown).view(np.uint8), max_cells, holes.view(np.uint8))
    return holes


def scipy_enclosed_holes(unknown: Bool[np.ndarray, "rows cols"], max_cells: float) -> Bool[np.ndarray, "rows cols"]:
    """The reference of :func:`enclosed_holes`."""
    labels = np.empty(unknown.shape, np.int32)
    count = int(ndimage.label(unknown, output=labels))  # pyright: ignore[reportArgumentType]
    if not count:
        return unknown
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    small = sizes <= max_cells
    small[0] = False
    return small[labels]
