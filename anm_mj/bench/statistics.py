"""Statistics of a comparison: censored steps, and paired differences with intervals over scenes.

Runs of one scene are not independent: starts and seeds are averaged within a scene, and the interval is that of a
bootstrap over scenes (Efron and Tibshirani, "An Introduction to the Bootstrap", 1993, chapter 13). Its percentiles are
expanded to what few scenes ask for (Hesterberg, "What Teachers Should Know About the Bootstrap", The American
Statistician 69, 2015): the usual ones of twelve scenes hold the mean nine times in ten. A run that never reaches a
level counts with its whole budget (restricted mean: Royston and Parmar, BMC Medical Research Methodology 13:152, 2013);
leaving it out would make a policy look faster by failing.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr, stdtrit

_Key = TypeVar("_Key")
_Value = TypeVar("_Value")
NUM_RESAMPLES = 10_000
LEVEL = 0.95
"""Confidence of the intervals."""
LEAST_SCENES = 6
"""With fewer scenes there is no interval: all resamples lie between the least and the largest value."""
TASK = ("scene", "start", "seed", "budget")
"""Columns in which two runs agree that are compared."""


@dataclass(frozen=True)
class PairedDifference:
    """How much larger a column is for one variant than for another, over the scenes that both ran in."""

    by_scene: Float[np.ndarray, " scenes"]
    """Mean over the pairs of each scene."""
    num_pairs: int

    @property
    def without_one(self) -> tuple[float, float] | None:
        """Least and largest mean without any one scene; None with fewer than two."""
        count = len(self.by_scene)
        if count < 2:
            return None
        others = (self.by_scene.sum() - self.by_scene) / (count - 1)
        return float(others.min()), float(others.max())

    @property
    def p_value(self) -> float | None:
        """Of Wilcoxon's signed-rank test over scenes, two-sided; None with too few of them that are not level."""
        if np.count_nonzero(self.by_scene) < LEAST_SCENES:
            return None
        from scipy.stats import wilcoxon  # It takes half a second to import.

        found: Any = wilcoxon(self.by_scene)
        return float(found.pvalue)


def case(row: Mapping[str, Any], same: Sequence[str] = TASK) -> tuple[Any, ...]:
    """What a row shares with those of other variants that it is compared with."""
    return tuple(row[key] for key in same)


def restricted_steps(steps: float | None, budget: int) -> float:
    """Steps to a level, censored at the budget where the run never got there (None or NaN)."""
    return float(budget) if steps is None or not np.isfinite(steps) else min(float(steps), float(budget))


def grouped(pairs: Iterable[tuple[_Key, _Value]]) -> dict[_Key, list[_Value]]:
    """The values of each key, in the order of their first appearance."""
    found: dict[_Key, list[_Value]] = {}
    for key, value in pairs:
        found.setdefault(key, []).append(value)
    return found


def scene_means(scenes: Sequence[str], values: Sequence[float]) -> Float[np.ndarray, " scenes"]:
    """Mean of each scene's values, given the scene of every value; in the order in which scenes appear."""
    return np.array([np.mean(found) for found in grouped(zip(scenes, values, strict=True)).values()])


def paired_difference(
    first: Sequence[Mapping[str, Any]], second: Sequence[Mapping[str, Any]], column: str, same: Sequence[str]
) -> PairedDifference | None:
    """Difference of a column between the runs of two variants, given by rows of the results table; the second one is
    subtracted. The runs of a pair agree in the columns ``same`` and have a number; None if there is no pair.
    """
    other = {case(row, same): row for row in second}
    scenes, differences = [], []
    for row in first:
        pair = other.get(case(row, same))
        if pair is None or row.get(column) is None or pair.get(column) is None:
            continue
        difference = float(row[column]) - float(pair[column])
        if np.isfinite(difference):
            scenes.append(row["scene"])
            differences.append(difference)
    if not scenes:
        return None
    return PairedDifference(scene_means(scenes, differences), len(scenes))


def bootstrap_interval(values: Float[np.ndarray, " n"]) -> tuple[float, float]:
    """Expanded percentile interval of the mean, by resampling two values or more; the same for the same values."""
    count = len(values)
    rng = np.random.default_rng(0)
    means = values[rng.integers(count, size=(NUM_RESAMPLES, count))].mean(axis=1)
    # A resample varies less than a sample does, by (n - 1) / n, and the normal distribution less than Student's.
    tail = float(ndtr(-math.sqrt(count / (count - 1)) * stdtrit(count - 1, (1.0 + LEVEL) / 2.0)))
    low, high = np.quantile(means, [tail, 1.0 - tail])
    return float(low), float(high)


def holm(p_values: Sequence[float | None]) -> list[float | None]:
    """P values adjusted for as many tests as there are (Holm, Scandinavian Journal of Statistics 6, 1979)."""
    known = sorted((p, k) for k, p in enumerate(p_values) if p is not None)
    adjusted: list[float | None] = [None] * len(p_values)
    largest = 0.0
    for rank, (p, k) in enumerate(known):
        largest = max(largest, min(1.0, (len(known) - rank) * p))
        adjusted[k] = largest
    return adjusted
