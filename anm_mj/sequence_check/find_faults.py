"""Says whether a recorded sequence fits together, and if not, what would make it fit.

Depth of frame pairs is carried from one camera into the other (:mod:`.misfit`). Where a correction makes the pairs fit
much better, in many of them and in hardly any worse, it is a finding; the best one is taken first.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from anm_mj.sequence_check.candidates import Candidate, candidates, colour_candidate, has_clock
from anm_mj.sequence_check.correction import Correction
from anm_mj.sequence_check.correction_trial import CorrectionTrial
from anm_mj.sequence_check.evidence import Evidence
from anm_mj.sequence_check.misfit import COLOUR_WEIGHT, Misfit
from anm_mj.sequence_check.surfaces import Surfaces

UNITS_M = (1.0 / 1000, 1.0 / 5000, 1.0 / 6553.5, 1.0 / 10000, 1.0 / 4000, 1.0 / 256, 1.0 / 100)
"""Units of depth images in use: millimetres, TUM, Replica, D405, L515, KITTI, centimetres. Not metres: surfaces in
whole metres would fit nothing, and what looks so are positions in millimetres."""
_UNIT_SHARE = 0.035
"""A factor that leads so near to one of them is one of depth, else one of the poses."""
_LEAST_GAIN = {"scale": 0.006, "focal": 0.006, "time": 0.006, "colour": 0.004}
"""A correction of these kinds lowers the mean cost by this much at least."""
_DISCRETE_GAIN = 0.03
_LEAST_SHARE = 0.03
"""And by this share of it."""
_FELT = 0.012
"""A pair feels a correction that changes its cost by more."""
_FEWEST_PAIRS = 3
"""So many pairs have to feel it."""
_AGREED, _AGREED_IF_LARGE = 0.8, 0.6
"""And so large a share of what they feel has to be for the better; the second where the gain is large."""
_LARGE = 2.5
"""A gain is large from so many times the least one on."""
_ROUNDS = (1.0, 2.5)
"""So many faults are looked for, one after the other; each has to gain so many times as much as a single one."""
_CONTRADICTS = 0.5
"""Where fewer of the points fit, the sequence contradicts itself, whatever the reason."""
_TOLD = 0.03
"""Pairs that share fewer of their points tell nothing."""
_AXES = {"z": (0.0, 0.0, 1.0), "-z": (0.0, 0.0, -1.0), "y": (0.0, 1.0, 0.0), "-y": (0.0, -1.0, 0.0)}
_UPRIGHT, _REFUTED = 0.75, 0.35
"""The upper edge of the images points along the vertical by more than the first cosine in the mean; an axis along which
it points by less than the second is not the vertical."""
_TILTED = 0.8
"""A camera that is held so steadily on its side, or looks so steadily down, tells nothing by itself."""
_LEVEL = 0.95
"""Cosine of a normal that points up."""
_STEEP = 2.0
"""Or it would rise so many times as far as it travels."""
_FLOOR_SHARE, _FLOOR_RATIO = 0.05, 2.0
"""Then so large a share of what it sees has to be floor, and so many times as much as along the stated axis."""


@dataclass(frozen=True)
class Fit:
    """How well frame pairs fit."""

    pairs: int
    coverage: float
    """Mean share of a frame's points that its neighbours show."""
    fitting: float
    """Median share of those that lie on the surface which the neighbour shows, as far as noise explains."""
    residual: float
    """Median distance from it as a share of depth."""
    spread: float
    """Half the distance between the quartiles of the pairs' medians."""


@dataclass(frozen=True)
class Finding:
    """A fault of the sequence."""

    kind: str
    """``poses``, ``axes``, ``mirrored``, ``ray``, ``scale``, ``unit``, ``focal``, ``time``, ``colour`` or ``up``, or
    two of them."""
    correction: Correction
    """That puts it right, together with those before it."""
    before: float
    """Share of fitting points without it."""
    after: float
    """And with it."""


@dataclass(frozen=True)
class Verdict:
    """What the check found."""

    stated: Fit
    """As the files have it."""
    corrected: Fit
    """With all findings put right; the same without any."""
    findings: tuple[Finding, ...]
    correction: Correction
    """Of all findings together."""

    @property
    def contradicts(self) -> bool:
        """Whether depth and poses contradict each other, with all that was found put right."""
        return self.corrected.fitting < _CONTRADICTS


def find_faults(
    evidence: Evidence, *, depth_unit_m: float, up: str | None = None, start: Correction | None = None
) -> Verdict:
    """Judge a sequence by the frames that were read of it. ``up`` is the axis that is taken to point up, None = that is
    no question; ``start`` is what is corrected already, and included in the verdict's correction.
    """
    trial = CorrectionTrial(evidence)
    correction, findings = start or Correction(), []
    first = misfit = trial.misfit(correction)
    for strictness in _ROUNDS:
        best = _best_finding(trial, correction, misfit, strictness)
        if best is None:
            break
        after = trial.misfit(best.correction)
        kind, correction = _named(best, depth_unit_m)
        findings.append(Finding(kind, correction, fit_of(misfit).fitting, fit_of(after).fitting))
        misfit = after
    axis = None if up is None else _other_up(trial, correction, up)
    if axis is not None:
        correction = replace(correction, up=axis)
        fitting = fit_of(misfit).fitting
        findings.append(Finding("up", correction, fitting, fitting))
    return Verdict(fit_of(first), fit_of(misfit), tuple(findings), correction)


def fit_of(misfit: Misfit) -> Fit:
    """The figures of some pairs."""
    told = np.isfinite(misfit.residual) & (misfit.inside > _TOLD)
    if not told.any():
        return Fit(0, 0.0, 0.0, np.nan, np.nan)
    low, middle, high = np.percentile(misfit.residual[told], (25, 50, 75))
    return Fit(
        int(told.sum()) // 2,
        float(np.mean(misfit.inside)),
        float(np.median(misfit.fits[told])),
        float(middle),
        float(high - low) / 2.0,
    )


def _best_finding(trial: CorrectionTrial, start: Correction, misfit: Misfit, strictness: float) -> Candidate | None:
    """The correction that explains most, if any explains enough."""
    before = misfit.cost
    found = [(one, _gain(one, before)) for one in candidates(trial, start)]
    if has_clock(trial) and start.colour_offset_s == 0.0:
        colour = colour_candidate(trial, start)
        share = COLOUR_WEIGHT / (1.0 + COLOUR_WEIGHT)
        found.append((colour, _gain(colour, trial.colour_cost(start)) * share))
    base = float(np.nanmean(before))
    enough = [(one, gain) for one, gain in found if _is_enough(one.kind, gain, base, strictness)]
    return max(enough, key=lambda pair: float(np.nanmean(pair[1])), default=(None, None))[0]


def _gain(candidate: Candidate, before: Float64[np.ndarray, " d"]) -> Float64[np.ndarray, " p"]:
    """What the cost of each pair goes down by, both ways round together."""
    gain = (before - candidate.cost).reshape(-1, 2)
    known = np.isfinite(gain)
    return np.where(known, gain, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)


def _is_enough(kind: str, gain: Float64[np.ndarray, " p"], base: float, strictness: float) -> bool:
    mean = float(np.mean(gain))
    least = strictness * max(_LEAST_GAIN.get(kind, _DISCRETE_GAIN), _LEAST_SHARE * base)
    if mean < least:
        return False
    agreed = _AGREED_IF_LARGE if mean > _LARGE * least else _AGREED
    scale = COLOUR_WEIGHT / (1.0 + COLOUR_WEIGHT) if kind == "colour" else 1.0
    felt = np.abs(gain) > _FELT * scale
    total = float(np.abs(gain[felt]).sum())
    better = int((gain > _FELT * scale).sum())
    return better >= _FEWEST_PAIRS and float(gain[felt].sum()) > (2.0 * agreed - 1.0) * total


def _named(found: Candidate, depth_unit_m: float) -> tuple[str, Correction]:
    """The kind, where a factor of the poses is told from one of the depth; pairs of frames cannot tell them apart."""
    correction = found.correction
    if found.kind != "scale":
        return found.kind, correction
    factor = correction.pose_scale
    unit_m = depth_unit_m / factor
    nearest = min(UNITS_M, key=lambda unit: abs(np.log(unit / unit_m)))
    if abs(np.log(factor)) > 0.15 and abs(np.log(nearest / unit_m)) < _UNIT_SHARE:
        return "unit", replace(correction, pose_scale=1.0, depth_scale=correction.depth_scale * nearest / depth_unit_m)
    return "scale", correction


def _other_up(trial: CorrectionTrial, correction: Correction, up: str) -> str | None:
    """The axis of the stated world that points up, where the way the camera is held refutes the stated one."""
    poses = trial.all_poses(correction)
    right, below, ahead = poses[:, :3, :3].mean(axis=0).T
    stated = np.array(_AXES[up])
    upright = {name: float(np.dot(-below, axis)) for name, axis in _AXES.items()}
    best = max(upright, key=lambda name: upright[name])
    if best == up or upright[best] < _UPRIGHT or upright[up] > _REFUTED:
        return None
    if abs(float(right @ stated)) > _TILTED or float(ahead @ stated) < -_TILTED:
        if _climbs(poses[:, :3, 3], stated, np.array(_AXES[best])):
            return best
        shown, of_views = trial.shown(correction), trial.view_poses(correction)
        floor, stated_floor = (_floor_share(shown, of_views, axis) for axis in (np.array(_AXES[best]), stated))
        if floor < max(_FLOOR_SHARE, _FLOOR_RATIO * stated_floor):
            return None
    return best


def _climbs(xyz: Float64[np.ndarray, "n 3"], stated: Float64[np.ndarray, "3"], best: Float64[np.ndarray, "3"]) -> bool:
    """Whether a camera would rise or sink by more than it travels; one that is carried does neither."""
    rises, levels = np.ptp(xyz @ stated), np.ptp(xyz @ best)
    across = np.ptp(xyz @ np.cross(stated, best))
    return bool(rises > _STEEP * max(across, levels))


def _floor_share(shown: Surfaces, poses: Float64[np.ndarray, "v 4 4"], up: Float64[np.ndarray, "3"]) -> float:
    """Share of the seen points that face up and lie below the camera."""
    in_camera = np.einsum("vij,i->vj", poses[:, :3, :3], up).astype(np.float32)
    known = np.isfinite(shown.points_m[..., 0])
    row, col = np.moveaxis(shown.images.points, -1, 0)
    normal = shown.planes(np.arange(len(row))[:, None], row, col).normal
    with np.errstate(invalid="ignore"):
        faces = np.einsum("vnj,vj->vn", normal, in_camera) > _LEVEL
        below = np.einsum("vnj,vj->vn", shown.points_m, in_camera) < 0.0
    return float((faces & below & known).sum() / max(known.sum(), 1))
