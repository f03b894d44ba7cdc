"""Which correction fits a sequence best."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from anm_mj.sequence_check.correction import CONVENTIONS, LARGEST_FACTOR, LEAST_FACTOR, Correction, all_axes
from anm_mj.sequence_check.correction_trial import CorrectionTrial

SCALES = tuple(np.exp(np.arange(-18, 19) * 0.17)) + tuple(
    factor * 10.0**power for power in (-4, -3, -2, 2, 3, 4) for factor in (0.75, 1.0, 1.35)
)
"""Tried for the poses: every 19 % from 1/21 to 21, and near powers of ten beyond."""
FOCAL_SCALES = tuple(np.exp(np.arange(-11, 12) * 0.085))
"""Tried for the focal length: every 9 % from 0.39 to 2.5."""
_OFFSETS = 15
"""Tried for time, to either side."""
_LONGEST_OFFSET_S = 0.5
_OFFSET_FRAMES = 5.5
"""Offsets go as far as the longer of the two: seconds, and so many intervals between frames."""
_INTERVALS = 15.0
"""But no farther than so many intervals."""
_REFINEMENTS, _BETWEEN = 3, 7
"""So many times a grid of so many values is laid between the neighbours of the best."""
_ALIKE = 0.004
"""Costs that differ by less tell nothing."""
_SURE = 0.93
"""Where this share of the points fits, poses and axes are what they are stated to be."""


@dataclass(frozen=True)
class Candidate:
    """A kind of fault, at its best value."""

    kind: str
    correction: Correction
    cost: Float64[np.ndarray, " d"]
    """By pair."""


def candidates(trial: CorrectionTrial, start: Correction) -> list[Candidate]:
    """The best of each kind of fault, beside what is corrected already; colour's time is another matter."""
    discrete = {
        "mirrored": [replace(start, mirrored=not start.mirrored)],
        "ray": [replace(start, ray_depth=not start.ray_depth)],
    }
    fits = trial.misfit(start).fits
    if not np.isfinite(fits).any() or np.nanmedian(fits) < _SURE:
        discrete |= {
            "poses": [replace(start, convention=name) for name in CONVENTIONS if name != start.convention],
            "axes": [replace(start, axes=axes) for axes in all_axes() if axes not in (start.axes, "LDF")],
            "poses and axes": [
                replace(start, convention=name, axes=axes) for name in CONVENTIONS[1:] for axes in ("RUB", "FLU")
            ],
        }
    found = [_best(trial, kind, corrections) for kind, corrections in discrete.items()]
    # Beside a factor that was found already, some are more than there can be.
    scales = [value for value in SCALES if LEAST_FACTOR <= start.pose_scale * value <= LARGEST_FACTOR]
    found.append(_refined(trial, "scale", scales, _by_factor(start, "pose_scale")))
    found.append(_refined(trial, "focal", FOCAL_SCALES, _by_factor(start, "focal_scale")))
    if has_clock(trial):
        found.append(_refined(trial, "time", offsets_s(trial), _by_offset(start, "time_offset_s"), factor=False))
    return found


def has_clock(trial: CorrectionTrial) -> bool:
    """Whether the frames have times of their own."""
    times = trial.evidence.times_s
    return len(times) > 3 and bool((np.diff(times) > 0.0).all())


def offsets_s(trial: CorrectionTrial) -> Float64[np.ndarray, " o"]:
    """Offsets of time to try [s]."""
    interval = float(np.median(np.diff(trial.evidence.times_s)))
    longest = max(_OFFSET_FRAMES * interval, min(_LONGEST_OFFSET_S, _INTERVALS * interval))
    return longest * np.arange(-_OFFSETS, _OFFSETS + 1) / _OFFSETS


def colour_candidate(trial: CorrectionTrial, start: Correction) -> Candidate:
    """The best offset of colour's time; its costs are those of colour alone."""
    by_offset = _by_offset(start, "colour_offset_s")
    return _refined(trial, "colour", offsets_s(trial), by_offset, factor=False, cost=trial.colour_cost)


def mean_cost(cost: Float64[np.ndarray, " d"]) -> float:
    """Mean over the pairs that have points; 1 without any."""
    return float(np.nanmean(cost)) if np.isfinite(cost).any() else 1.0


def _by_factor(start: Correction, name: str) -> Callable[[float], Correction]:
    return lambda value: replace(start, **{name: getattr(start, name) * value})


def _by_offset(start: Correction, name: str) -> Callable[[float], Correction]:
    return lambda value: replace(start, **{name: getattr(start, name) + value})


def _best(trial: CorrectionTrial, kind: str, corrections: Sequence[Correction]) -> Candidate:
    costs = [mean_cost(trial.misfit(correction, thin=True).cost) for correction in corrections]
    best = min(costs)
    # Of those that explain the frames alike the first: a camera that only turns cannot tell all axes apart.
    chosen = next(at for at, cost in enumerate(costs) if cost <= best + _ALIKE)
    return Candidate(kind, corrections[chosen], trial.misfit(corrections[chosen]).cost)


def _refined(
    trial: CorrectionTrial,
    kind: str,
    values: Sequence[float] | np.ndarray,
    make: Callable[[float], Correction],
    *,
    factor: bool = True,
    cost: Callable[[Correction], Float64[np.ndarray, " d"]] | None = None,
) -> Candidate:
    """The best value of a continuous kind: from a grid, then between its neighbours."""
    ordered = sorted(float(value) for value in values)
    coarse = cost or (lambda correction: trial.misfit(correction, thin=True).cost)
    fine = cost or (lambda correction: trial.misfit(correction).cost)
    grid = [mean_cost(coarse(make(value))) for value in ordered]
    at = int(np.argmin(grid))
    low, high = ordered[max(at - 1, 0)], ordered[min(at + 1, len(ordered) - 1)]
    best = Candidate(kind, make(ordered[at]), fine(make(ordered[at])))
    for _ in range(_REFINEMENTS):
        between = (np.geomspace(low, high, _BETWEEN) if factor else np.linspace(low, high, _BETWEEN)).tolist()
        costs = [fine(make(value)) for value in between]
        at = int(np.argmin([mean_cost(one) for one in costs]))
        best = Candidate(kind, make(between[at]), costs[at])
        low, high = between[max(at - 1, 0)], between[min(at + 1, _BETWEEN - 1)]
    return best
