"""What the check found, in words and as options of ``anm-mj map``."""

from typing import Any

from anm_mj.io.sequence import Sequence
from anm_mj.sequence_check.correction import AXES_NAMES, Correction
from anm_mj.sequence_check.find_faults import Finding, Verdict


def options(correction: Correction, sequence: Sequence, given: Correction) -> list[str]:
    """The options that apply a correction, without those that the command line has ``given``."""
    k, scale = sequence.intrinsics, correction.focal_scale
    words = {
        "convention": f"--poses {correction.convention}",
        "axes": f"--axes {correction.axes}",
        "mirrored": "--mirrored" if correction.mirrored else "no --mirrored",
        "ray_depth": "--ray-depth" if correction.ray_depth else "no --ray-depth",
        "depth_scale": f"--depth-unit {sequence.depth_unit_m * correction.depth_scale:.6g}",
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
