"""Gaps between what a path leads to and parts of the graph that are in plain sight, but behind a passage too narrow.

Seen from afar, and with a depth camera's noise, obstacles are thicker than they are. Seen from beside it, a passage may
turn out to be wide enough.
"""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from anm_mj.planning.paths import segments_clear
from anm_mj.planning.stages import PlanningState

GAP_M = 2.0
"""The parts of the graph on both sides of a passage lie at most this far apart [m]."""
_NEAR = 8
"""So many vertices beyond are looked at from each."""


def narrow_gaps(now: PlanningState) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, "n 2"]]:
    """Vertices that a path leads to, and for each the nearest vertex that none leads to, in plain sight [m].

    No obstacle and nothing unknown lies between them.
    """
    xy_m, reached = now.graph.vertex_xy_m, np.isfinite(now.paths.distance_m)
    if reached.all() or not reached.any():
        return np.zeros(0, np.int64), np.zeros((0, 2))
    vertex, beyond = np.flatnonzero(reached), xy_m[~reached]
    near = min(_NEAR, len(beyond))
    apart_m, nearest = (np.reshape(each, (-1, near)) for each in KDTree(beyond).query(xy_m[vertex], k=near))
    # A wall may stand before the nearest one.
    which, place = np.nonzero(apart_m <= GAP_M)
    ends = beyond[nearest[which, place]]
    clear = segments_clear(now.topdown, xy_m[vertex[which]], ends, 0.0, now.pose)
    found, first = np.unique(which[clear], return_index=True)
    return vertex[found], ends[clear][first]
