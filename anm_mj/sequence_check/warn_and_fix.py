"""The check as ``anm-mj map`` does it: look at some frames, say what is wrong and which options put it right."""

import logging
from dataclasses import dataclass, field, replace
from typing import Any

from anm_mj.errors import ConfigError
from anm_mj.io.sequence import Sequence
from anm_mj.sequence_check.correction import AXES_NAMES, Correction, combined, corrected_sequence
from anm_mj.sequence_check.evidence import gather
from anm_mj.sequence_check.find_faults import Finding, Verdict, find_faults

_logger = logging.getLogger(__name__)


def options(correction: Correction, sequence: Sequence, given: Correction) -> list[str]:
    """The options that apply a correction, without those that the command line has ``given``."""
    k, scale = sequence.intrinsics, correction.focal_scale
    words = {
        "convention": f"--poses {correction.convention}",
        "axes": f"--axes {correction.axes}",
        "mirrored": "--mirrored" if correction.mirrored else "no --mirrored",
        "ray_depth": "--ray-depth" if correction.ray_depth else "no --ray-depth",
        "depth_scale": f"--depth-unit {sequence.stated_unit_m * correction.depth_scale:.6g}",
        "pose_scale": f"--pose-scale {correction.pose_scale:.4g}",
        "focal_scale": f"--camera {k.fx * scale:.5g},{k.fy * scale:.5g},{k.cx:.5g},{k.cy:.5g}",
        "time_offset_s": f"--time-offset={correction.time_offset_s:.3f}",
        "colour_offset_s": f"--colour-offset={correction.colour_offset_s:.3f}",
    }
    changed = [option for name, option in words.items() if getattr(correction, name) != getattr(given, name)]
    return changed if correction.up is None else [*changed, f"--up={correction.up}"]


def explanation(finding: Finding) -> str:
    """What is wrong, in words."""
    found = finding.correction
    axes = f"the camera axes are {found.axes}" + (f" ({AXES_NAMES[found.axes]})" if found.axes in AXES_NAMES else "")
    poses = {
        "camera-to-world": "the poses are of the camera in the world",
        "world-to-camera": "the poses are inverse (of the world in the camera)",
        "conjugate": "the rotations of the poses are the other way round (conjugated quaternions)",
        "scalar-first": "the quaternions are written w x y z",
        "scalar-first-inverse": "the poses are inverse, with quaternions written w x y z",
    }[found.convention]
    return {
        "poses": poses,
        "axes": axes,
        "poses and axes": f"{poses}, and {axes}",
        "mirrored": "the images are mirrored",
        "ray": "depth is the distance along the ray, not planar",
        "scale": f"positions are {1.0 / found.pose_scale:.4g} times what depth says",
        "unit": f"depth is {1.0 / found.depth_scale:.4g} times what the poses say: another unit",
        "focal": f"the focal length is {1.0 / found.focal_scale:.3g} times the true one",
        "time": f"the clock of the poses is {1000.0 * found.time_offset_s:+.0f} ms ahead of that of the images",
        "colour": f"colour is stamped {-1000.0 * found.colour_offset_s:+.0f} ms against its depth",
        "up": f"the cameras are held as if {found.up} pointed up",
    }[finding.kind]


def facts(verdict: Verdict) -> dict[str, Any]:
    """The figures of the check for ``metrics.json``."""
    fit = verdict.corrected
    return {
        "check_pairs": fit.pairs,
        "check_coverage_percent": 100.0 * fit.coverage,
        "check_fitting_percent": 100.0 * fit.fitting,
        "check_residual_percent": 100.0 * fit.residual,
        "check_residual_spread_percent": 100.0 * fit.spread,
        "check_findings": [finding.kind for finding in verdict.findings],
    }


@dataclass
class BeforeMapping:
    """Judges a sequence once its files are read, and before its floor is looked for."""

    given: Correction = field(default_factory=Correction)
    """Applied first: what the command line says."""
    fix: bool = False
    """Whether findings are applied, too."""
    keeps_up: bool = False
    """Whether the axis that points up was given."""
    verdict: Verdict | None = None
    """After the call; None where too little could be read, or there are no poses."""
    applied: tuple[str, ...] = ()
    """Options that ``fix`` stands for, after the call."""

    def __call__(self, sequence: Sequence, up: str) -> tuple[Sequence, str]:
        """The sequence put right, and the axis that points up. Raises ConfigError if a correction of poses was given
        for a sequence without any.
        """
        if not sequence.has_poses:
            wrong = self.given.changes().keys() & {"convention", "axes", "pose_scale", "time_offset_s"}
            if wrong:
                raise ConfigError(
                    f"{sequence.path} has no poses; leave out what corrects them ({', '.join(sorted(wrong))})."
                )
            return corrected_sequence(sequence, self.given), up
        # A convention and axes are found in place of the given ones, all else on top.
        before = replace(self.given, convention=Correction.convention, axes=Correction.axes)
        prepared = corrected_sequence(sequence, before)
        evidence = gather(prepared)
        if evidence is None:
            return corrected_sequence(sequence, self.given), up
        self.verdict = find_faults(
            evidence,
            depth_unit_m=prepared.stated_unit_m,
            up=None if self.keeps_up else up,
            start=Correction(self.given.convention, self.given.axes),
        )
        if not self.verdict.findings:
            self._say(sequence, [])
            return corrected_sequence(sequence, self.given), up
        correction = combined(before, self.verdict.correction)
        words = options(correction, sequence, self.given)
        self._say(sequence, words)
        if not self.fix:
            return corrected_sequence(sequence, self.given), up
        self.applied = tuple(words)
        return corrected_sequence(sequence, correction), correction.up or up

    def _say(self, sequence: Sequence, words: list[str]) -> None:
        assert self.verdict is not None, "the sequence was judged"
        for finding in self.verdict.findings:
            shares = (
                f"{100 * finding.before:.0f} % of the compared points fit without it and {100 * finding.after:.0f} %"
            )
            after = "" if finding.kind == "up" else f"; {shares} with it"
            _logger.warning("%s does not fit together: %s%s.", sequence.path, explanation(finding), after)
        if words:
            done = " (applied, --fix)" if self.fix else ", or --fix"
            _logger.warning("This puts it right: %s%s.", " ".join(words), done)
        if self.verdict.contradicts:
            _logger.warning(
                "Depth and poses of %s contradict each other: only %.0f %% of the points that frames share fit, and "
                "nothing that was tried explains it. The map will be wrong. Check poses, camera and clock, or find the "
                "poses by --track.",
                sequence.path,
                100 * self.verdict.corrected.fitting,
            )
