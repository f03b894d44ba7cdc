"""Completion without the cap at 1 m: needed once, at the end, so it is computed from all frames again."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice

import numpy as np
from jaxtyping import Float, Float32
from scipy.spatial import KDTree

from anm_mj.evaluation.coverage import BATCH_FRAMES, DistanceBound


def uncapped_mean_cm(
    samples: Float32[np.ndarray, "n 3"],
    distance_m: Float[np.ndarray, " n"],
    clouds: Iterable[Float[np.ndarray, "m 3"]],
) -> float | None:
    """Mean distance of all samples to the nearest seen point [cm]; None where nothing was seen at all.

    Args:
        samples: Samples of the true surface, world [m].
        distance_m: Their distances below 1 m, infinite elsewhere, as :class:`~anm_mj.evaluation.coverage.Coverage`
            has them.
        clouds: The seen points of every frame, world [m].
    """
    far = np.flatnonzero(np.isinf(distance_m))
    full_m = distance_m.copy()
    if len(far):
        full_m[far] = _nearest(samples[far].astype(np.float64), clouds)
    mean_m = float(np.mean(full_m))
    return 100.0 * mean_m if np.isfinite(mean_m) else None


def _nearest(points: Float[np.ndarray, "n 3"], clouds: Iterable[Float[np.ndarray, "m 3"]]) -> Float[np.ndarray, " n"]:
    bound = DistanceBound(points)
    nearest_m = np.full(len(points), np.inf)
    remaining = iter(clouds)
    while batch := list(islice(remaining, BATCH_FRAMES)):
        seen = np.concatenate(batch)
        if len(seen) == 0:
            continue
        improvable = np.flatnonzero(bound.per_cell(seen)[bound.cell] < nearest_m)
        if len(improvable):
            tree = KDTree(seen, balanced_tree=False, compact_nodes=False)
            found_m, _ = tree.query(points[improvable])
            nearest_m[improvable] = np.minimum(nearest_m[improvable], found_m)
    return nearest_m
