"""Small parts of a map of the plane that hang together."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool

from anm_mj import _native


def enclosed_holes(unknown: Bool[np.ndarray, "rows cols"], max_cells: float) -> Bool[np.ndarray, "rows cols"]:
    """The cells of parts of a mask, connected by sides, that have no more than ``max_cells``."""
    holes = np.zeros(unknown.shape, bool)
    _native.small_components(np.ascontiguousarray(unknown).view(np.uint8), max_cells, holes.view(np.uint8))
    return holes
