"""How much of the observed surface a map has carved away, such as where somebody walked before a wall."""

import itertools

import numpy as np
from jaxtyping import Float

from anm_mj.types import FREE, OCCUPIED, OccupancyGrid

_REACH = 2
"""A sample counts as observed up to 5 cm from what was measured: two voxels away, where it lies at an edge."""


def surface_lost_percent(grid: OccupancyGrid, samples_m: Float[np.ndarray, "n 3"]) -> float | None:
    """Share of points on the observed surface that the map takes for free, with nothing occupied near them [%]. None of
    no points.
    """
    last = np.array(grid.state.shape[::-1]) - 1
    cells = np.floor((samples_m - grid.origin_m) / grid.resolution_m).astype(np.int64)
    if not len(cells) or (last < 0).any():
        return None
    col, row, layer = cells.clip(0, last).T
    lost = cells[(grid.state[layer, row, col] == FREE) & ((cells >= 0) & (cells <= last)).all(axis=1)]
    for offset in itertools.product(range(-_REACH, _REACH + 1), repeat=3):
        col, row, layer = (lost + offset).clip(0, last).T
        lost = lost[grid.state[layer, row, col] != OCCUPIED]
    return 100.0 * len(lost) / len(cells)
