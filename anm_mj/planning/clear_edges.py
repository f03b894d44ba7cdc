"""Which straight edges keep away from all that is not free, whatever their length: bisected, few samples each.

The distance to an obstacle changes along an edge no faster than the edge is long. An edge whose middle is farther from
all obstacles than half its length and the clearance asked for is clear as a whole; one whose middle is too near to an
obstacle is not; all others are two edges of half the length. Long edges in the open take one sample, edges along walls
one per half a cell.
"""

import math

import numpy as np
from jaxtyping import Bool, Float, Int

from anm_mj.types import TopDownMap

LEAF_CELLS = 0.25
"""Parts of edges with a shorter half than this are known by their middle: two samples per cell [cells]."""


def clear_edges(
    topdown: TopDownMap, start_xy_m: Float[np.ndarray, "n 2"], end_xy_m: Float[np.ndarray, "n 2"], least_m: float
) -> Bool[np.ndarray, " n"]:
    """Whether each edge between world points keeps a clearance on all of its length [m].

    ``least_m`` is the clearance asked for, to cells that are occupied or unknown; it is more than half a cell, so that
    no obstacle fits between two samples. What lies outside of the map is not free.
    """
    resolution = topdown.resolution_m
    rows, cols = topdown.clearance_m.shape
    clearance = topdown.clearance_m.ravel()
    clear = np.ones(len(start_xy_m), bool)
    start = (start_xy_m - topdown.origin_xy_m) / resolution
    along = (end_xy_m - start_xy_m) / resolution
    half = np.hypot(along[:, 0], along[:, 1]) / 2.0
    middle = (start + along / 2.0).T
    step = (along / 4.0).T
    which: Int[np.ndarray, " p"] = np.arange(len(start))
    while len(which):
        x, y = middle
        inside = (x >= 0.0) & (x < cols) & (y >= 0.0) & (y < rows)
        cell = np.where(inside, y, 0.0).astype(np.int64) * cols + np.where(inside, x, 0.0).astype(np.int64)
        here = np.where(inside, clearance[cell], -np.inf)
        clear[which[here < least_m]] = False
        # The middle and the nearest point of the obstacle may each lie anywhere in its cell.
        open_ = here >= least_m + (half + math.sqrt(2.0)) * resolution
        split = np.flatnonzero(~open_ & (half > LEAF_CELLS) & clear[which])
        middle, step = middle[:, split], step[:, split]
        middle = np.concatenate([middle - step, middle + step], axis=1)
        step = np.tile(step / 2.0, 2)
        which, half = np.tile(which[split], 2), np.tile(half[split] / 2.0, 2)
    return clear
