"""The tiers of candidates: which kind of vertex comes before which, whatever its distance (paper, section III-C).

The order within a tier is in :mod:`anm_mj.planning.policies.anm_s.ordering`.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int

UNVISITED, IN_HORIZON, ANCHORED, FAILED = 3, 2, 1, -6
"""Weights of a vertex's properties in the authors' released code."""


def tiers(
    unvisited: Bool[np.ndarray, " n"],
    near: Bool[np.ndarray, " n"],
    anchored: Bool[np.ndarray, " n"],
    failed: Bool[np.ndarray, " n"],
) -> Int[np.ndarray, " n"]:
    """Sum of the weights of each vertex's properties; larger is better.

    An anchored region counts in the local horizon alone; ``failed`` vertices led into an obstacle.
    """
    return UNVISITED * unvisited + IN_HORIZON * near + ANCHORED * (anchored & near) + FAILED * failed
