"""While mapping: how well each frame fits the map of the frames before it, and what a run of misfits means."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float64

from anm_mj.io.sequence import ranges_text
from anm_mj.localisation.frame_points import grid_points
from anm_mj.localisation.localiser import PoseEstimate, TrackingState
from anm_mj.localisation.map_probe import agreement
from anm_mj.types import Observation

if TYPE_CHECKING:
    from anm_mj.mapping.neural_map import NeuralMap

_logger = logging.getLogger(__name__)

POINTS = 150
"""About so many points of a frame are looked at."""
_KNOWN = 0.3
"""Frames of which the map knows a smaller share of the points tell nothing."""
_FITS = 0.6
"""A frame that the map confirms in a smaller share of the known points does not fit, where others do."""
_USUAL_SHARE = 0.75
"""Nor does one that it confirms in less than this share of what is usual in the sequence."""
_FIRST = 3
"""The first frames meet no map yet."""
_ALTERNATE = 0.6
"""Two tracks are interleaved where so large a share of the neighbours of misfits fit, and one of so many does not."""
_MANY = 0.25
_JUMP_M, _JUMP_TIMES, _MISFIT_JUMP_TIMES, _STILL_M = 0.2, 5.0, 1.7, 0.005
"""A pose jumps by at least this, and by so many times the usual step; by fewer where the frame does not fit the map.
Shorter steps are none."""
_DRIFTS = 2.0
"""Residuals at the end that are so many times those at the beginning are drift."""


@dataclass(frozen=True)
class FrameFit:
    """Of one frame."""

    known: float
    """Share of its points that the map says something of."""
    fitting: float | None
    """Share of those that the map confirms; None where it knows too little."""
    residual_m: float | None
    """Median distance of the confirmed points from the map's surface."""


def frame_fit(observation: Observation, neural_map: NeuralMap, estimate: PoseEstimate | None = None) -> FrameFit:
    """Hold a frame against the map, before it enters that; ``estimate`` is what localisation says of its pose. Where
    nobody knows that, nothing is known of its points.
    """
    points = grid_points(observation, POINTS)
    is_lost = estimate is not None and estimate.state is TrackingState.LOST
    if observation.step < _FIRST or is_lost or not len(points):
        return FrameFit(0.0, None, None)
    found = agreement(points, observation.T_world_camera, neural_map.occupancy.by_depth)
    if found.known < _KNOWN:
        return FrameFit(found.known, None, None)
    T = observation.T_world_camera
    world = points[found.confirmed].astype(np.float64) @ T[:3, :3].T + T[:3, 3]
    # Faster than np.median, of so few.
    residual = float(np.sort(np.abs(neural_map.sdf(world)))[len(world) // 2]) if len(world) else None
    return FrameFit(found.known, found.share, residual)


def fit_metrics(fits: Sequence[FrameFit]) -> dict[str, Any]:
    """The figures of all frames for ``metrics.json``."""
    shares = [fit.fitting for fit in fits if fit.fitting is not None]
    residuals = [100.0 * fit.residual_m for fit in fits if fit.residual_m is not None]
    if not residuals:
        return {"fit_percent": None, "fit_residual_cm": None, "fit_residual_spread_cm": None, "misfits": None}
    low, middle, high = np.percentile(residuals, (25, 50, 75))
    return {
        "fit_percent": 100.0 * float(np.median(shares)),
        "fit_residual_cm": float(middle),
        "fit_residual_spread_cm": float(high - low) / 2.0,
        "misfits": len(misfits(fits)),
    }


def misfits(fits: Sequence[FrameFit]) -> list[int]:
    """Numbers of the frames that do not fit the map."""
    shares = [fit.fitting for fit in fits if fit.fitting is not None]
    if not shares:
        return []
    limit = max(_FITS, _USUAL_SHARE * float(np.percentile(shares, 75)))
    return [at for at, fit in enumerate(fits) if fit.fitting is not None and fit.fitting < limit]


def jumps(positions_m: Float64[np.ndarray, "n 3"], wrong: Sequence[int]) -> list[int]:
    """Numbers of the frames whose pose lies much farther from the one before than is usual. Of frames that do not fit
    the map, ``wrong``, a smaller jump is one; to and from a position of NaN, as of a lost camera, none is.
    """
    steps = np.linalg.norm(np.diff(positions_m, axis=0), axis=1)
    moving = steps[steps > _STILL_M]
    if len(moving) < _FIRST:
        return []
    usual = float(np.median(moving))
    limit = np.full(len(steps), max(_JUMP_M, _JUMP_TIMES * usual))
    limit[[at - 1 for at in wrong if at > 0]] = max(_JUMP_M, _MISFIT_JUMP_TIMES * usual)
    return (np.flatnonzero(steps > limit) + 1).tolist()


def say_misfits(
    fits: Sequence[FrameFit], positions_m: Float64[np.ndarray, "n 3"], times_s: Sequence[float], steps: Sequence[int]
) -> None:
    """Warn of frames that contradict the map, by their numbers ``steps`` in the sequence, and name what it looks
    like.
    """
    wrong = misfits(fits)
    leaps = jumps(positions_m, wrong)
    if leaps:
        sizes = [float(np.linalg.norm(positions_m[at] - positions_m[at - 1])) for at in leaps]
        words = ", ".join(
            f"{size:.2f} m at frame {steps[at]} ({times_s[at]:.3f} s)"
            for at, size in zip(leaps[:5], sizes, strict=False)
        )
        more = f" and {len(leaps) - 5} more" if len(leaps) > 5 else ""
        _logger.warning("The poses jump: %s%s.", words, more)
    if wrong:
        _logger.warning(
            "%d of %d frames do not fit the map of those before: %s. %s",
            len(wrong),
            len(fits),
            ranges_text([steps[at] for at in wrong]),
            _looks_like(wrong, fits),
        )
    residuals = [fit.residual_m for fit in fits if fit.residual_m is not None]
    third = len(residuals) // 3
    if third >= 10:
        begin, end = float(np.median(residuals[:third])), float(np.median(residuals[-third:]))
        if end > max(_DRIFTS * begin, 0.02):
            _logger.warning(
                "The frames drift from the map: their median distance grows from %.1f to %.1f cm.",
                100 * begin,
                100 * end,
            )


def _looks_like(wrong: Sequence[int], fits: Sequence[FrameFit]) -> str:
    told = [at for at, fit in enumerate(fits) if fit.fitting is not None]
    if len(wrong) > 0.5 * len(told):
        return "Poses, camera or depth contradict each other throughout."
    alone = [at for at in wrong if not {at - 1, at + 1} & set(wrong)]
    if len(alone) >= _ALTERNATE * len(wrong) and len(wrong) >= max(4, _MANY * len(told)):
        return "Every other one fits: two tracks may be interleaved."
    if len(alone) == len(wrong):
        return "Their poses are single outliers."
    return "A run of them looks like a jump of the poses that stays."
