"""Statistics of a comparison: censored steps, and paired differences with intervals over scenes.

Runs of one scene are not independent: starts and seeds are averaged within a scene, and the interval is that of a
bootstrap over scenes (Efron and Tibshirani, "An Introduction to the Bootstrap", 1993, chapter 13). A run that never
reaches a level counts with its whole budget (restricted mean: Royston and Parmar, BMC Medical Research Methodology
13:152, 2013); leaving it out would make a policy look faster by failing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

NUM_RESAMPLES = 10_000
LEVEL = 0.95
"""Confidence of the intervals."""
LEAST_SCENES = 3
"""With fewer scenes there is no interval."""
_PAIR = ("scene", "start", "seed", "budget")
"""What two runs share that are compared."""


@dataclass(frozen=True)
class PairedDifference:
    """How much larger a column is for one variant than for another, over the scenes that both ran in."""

    mean: float
    interval: tuple[float, float] | None
    """95 % bootstrap interval over scenes; None with fewer than three scenes."""
    num_scenes: int
    num_pairs: int


def restricted_steps(steps: float | None, budget: int) -> float:
    """Steps to a level, censored at the budget where the run never got there (None or NaN)."""
    return float(budget) if steps is None or not np.isfinite(steps) else min(float(steps), float(budget))


def paired_difference(
    first: Sequence[Mapping[str, Any]], second: Sequence[Mapping[str, Any]], column: str
) -> PairedDifference | None:
    """Difference of a column between the runs of two variants that share scene, start, seed and budget.

    Args:
        first: rows of the results table of one variant.
        second: those of the other, which is subtracted.
        column: the column; pairs in which one run lacks it are left out.

    Returns:
        None if there is no pair.
    """
    other = {tuple(row[key] for key in _PAIR): row for row in second}
    per_scene: dict[str, list[float]] = {}
    for row in first:
        pair = other.get(tuple(row[key] for key in _PAIR))
        if pair is None or row.get(column) is None or pair.get(column) is None:
            continue
        difference = float(row[column]) - float(pair[column])
        if np.isfinite(difference):
            per_scene.setdefault(row["scene"], []).append(difference)
    if not per_scene:
        return None
    means = np.array([np.mean(values) for values in per_scene.values()])
    return PairedDifference(
        float(means.mean()),
        bootstrap_interval(means) if len(means) >= LEAST_SCENES else None,
        len(means),
        sum(map(len, per_scene.values())),
    )


def bootstrap_interval(values: Float[np.ndarray, " n"], seed: int = 0) -> tuple[float, float]:
    """Percentile interval of the mean, by resampling the values; the same for the same values."""
    rng = np.random.default_rng(seed)
    means = values[rng.integers(len(values), size=(NUM_RESAMPLES, len(values)))].mean(axis=1)
    low, high = np.quantile(means, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0])
    return float(low), float(high)
