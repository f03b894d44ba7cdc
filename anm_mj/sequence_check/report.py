"""What the check found, in words and as options of ``anm-mj map``."""

from typing import Any

from anm_mj.io.sequence import Sequence
from anm_mj.sequence_check.correction import AXES_NAMES, Correction
from anm_mj.sequence_check.find_faults import Finding, Verdict


def options(correction: Correction, sequence: Sequence, given: Correction) -> list[str]:
    """The options that apply a correction, without those that the command line has ``given``."""
    words = []
    if correction.convention != given.convention:
        words.append(f"--poses {correction.convention}")
    if correction.axes != given.axes:
        words.append(f"--axes {correction.axes}")
    for name, now, then in (
        ("--mirrored", correction.mirrored, given.mirrored),
        ("--ray-depth", correction.ray_depth, given.ray_depth),
    ):
        if now != then:
            words.append(name if now else f"no {name}")
    if correction.depth_scale != given.depth_scale:
        words.append(f"--depth-unit {sequence.depth_unit_m * correction.depth_scale:.6g}")
    if correction.pose_scale != given.pose_scale:
        words.append(f"--pose-scale {correction.pose_scale:.4g}")
    if correction.focal_scale != given.focal_scale:
        k, scale = sequence.intrinsics, correction.focal_scale
        words.append(f"--camera {k.fx * scale:.5g},{k.fy * scale:.5g},{k.cx:.5g},{k.cy:.5g}")
    if correction.time_offset_s != given.time_offset_s:
        words.append(f"--time-offset={correction.time_offset_s:.3f}")
    if correction.colour_offset_s != given.colour_offset_s:
        words.append(f"--colour-offset={correction.colour_offset_s:.3f}")
    if correction.up is not None:
        words.append(f"--up={correction.up}")
    return words


def explanation(finding: Finding) -> str:
    """What is wrong, in words."""
    found = finding.correction
    name = AXES_NAMES.get(found.axes, found.axes)
    poses = {
        "camera-to-world": "the poses are of the camera in the world",
        "world-to-camera": "the poses are inverse (of the world in the camera)",
        "conjugate": "the rotations of the poses are the other way round (conjugated quaternions)",
        "scalar-first": "the quaternions are written w x y z",
        "scalar-first-inverse": "the poses are inverse, with quaternions written w x y z",
    }[found.convention]
    return {
        "poses": poses,
        "axes": f"the camera axes are {found.axes} ({name})"
        if name != found.axes
        else f"the camera axes are {found.axes}",
        "poses and axes": f"{poses}, and the camera axes are {found.axes} ({name})",
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
