"""How good the check of recorded sequences is: what it detects, names rightly, and says of sound ones.

python scripts/check_sequences.py
python scripts/check_sequences.py --scenes office room --seed 1 --faulty-count 200 --sound-count 100

Each of the faulty recordings has one fault, of a kind and size drawn by the seed, from hardly to grossly wrong. It
counts where it moves the points of one frame by more than 1 % of their depth in the frames beside it, in the mean: 2 cm
at 2 m, about what a depth camera errs by itself. A smaller one is listed apart. Sound recordings have the noise of a
D435i, an odometry that drifts by 1 %, or somebody who walks before the camera, or all of it.
"""

from __future__ import annotations

import time
from collections import defaultdict
from typing import Any

import numpy as np
from recorded_faults import KINDS, Recording, Walk, faulty, sound, walks

from anm_mj.cli.command_line import run_script
from anm_mj.sequence_check.correction import Correction
from anm_mj.sequence_check.correction_trial import CorrectionTrial
from anm_mj.sequence_check.evidence import Evidence, gather
from anm_mj.sequence_check.find_faults import Verdict, find_faults
from anm_mj.sequence_check.misfit import carry, project

COUNTS = 0.01
"""A fault that moves points by a smaller share of their depth does not count."""


def moved(evidence: Evidence, true: Correction) -> float:
    """By what share of their depth points of one frame lie wrong in another, in the mean over the compared pairs."""
    if true.up is not None:
        return np.inf
    trial, pairs = CorrectionTrial(evidence), evidence.pairs
    stated = Correction()
    if true.colour_offset_s:
        poses = trial.view_poses(Correction(time_offset_s=true.colour_offset_s))
        step = np.linalg.inv(poses) @ trial.view_poses(stated)
        points = trial.shown(stated).points_m
        wrong = np.linalg.norm(carry(points, step) - points, axis=-1) / points[..., 2]
        return float(np.nanmean(wrong))
    if true.mirrored:
        shown, poses = trial.shown(stated).points_m[pairs[:, 0]], trial.view_poses(stated)
        T = np.linalg.inv(poses[pairs[:, 1]]) @ poses[pairs[:, 0]]
        flip = np.array([-1.0, 1.0, 1.0], np.float32)
        should = carry(shown * flip, T) * flip
        wrong = np.linalg.norm(carry(shown, T) - should, axis=-1) / should[..., 2]
        return float(np.nanmean(np.clip(wrong, 0.0, 1.0)))
    there = []
    for correction in (stated, true):
        poses, shown = trial.view_poses(correction), trial.shown(correction)
        T = np.linalg.inv(poses[pairs[:, 1]]) @ poses[pairs[:, 0]]
        there.append((carry(shown.points_m[pairs[:, 0]], T), shown.camera))
    (said, camera), (truly, true_camera) = there
    at = project(truly, true_camera)
    x, y = (at.x - camera.cx) / camera.fx, (at.y - camera.cy) / camera.fy
    z = truly[..., 2]
    if true.ray_depth:
        z = z * np.sqrt(1.0 + x * x + y * y)
    should = np.stack((x * z, y * z, z), axis=-1)
    shares = np.linalg.norm(said - should, axis=-1) / z
    return float(np.minimum(shares[at.inside], 1.0).mean())


def main(
    scenes: tuple[str, ...] = ("office", "room"),
    seed: int = 1,
    faulty_count: int = 200,
    sound_count: int = 100,
    verbose: bool = False,
) -> None:
    """Make recordings, check them and count.

    Args:
        scenes: what the recordings are made in.
        seed: of the walks, the faults and their sizes.
        faulty_count: recordings with a fault.
        sound_count: recordings without.
        verbose: whether each recording is printed.
    """
    recorded = [walk for scene in scenes for walk in walks(scene, seed)]
    counted: dict[str, list[tuple[bool, bool]]] = defaultdict(list)
    small: list[bool] = []
    took = []
    for number in range(faulty_count):
        rng = np.random.default_rng([seed, 1, number])
        walk, kind = recorded[int(rng.integers(len(recorded)))], str(rng.choice(KINDS))
        made = faulty(walk, rng, kind, **_disturbed(rng))
        verdict, evidence, seconds = _judged(made)
        took.append(seconds)
        detected, named = bool(verdict.findings) or verdict.contradicts, _is_named(verdict, made)
        size = moved(evidence, made.expected)
        if size < COUNTS:
            small.append(detected)
        else:
            counted[kind].append((detected, named))
        if verbose or (size >= COUNTS and not named):
            _print(number, walk, made, verdict, size, detected, named)
    alarms = 0
    for number in range(sound_count):
        rng = np.random.default_rng([seed, 2, number])
        walk = recorded[int(rng.integers(len(recorded)))]
        made = sound(walk, rng, **_disturbed(rng))
        verdict, _, seconds = _judged(made)
        took.append(seconds)
        alarm = bool(verdict.findings) or verdict.contradicts
        alarms += alarm
        if verbose or alarm:
            _print(number, walk, made, verdict, 0.0, alarm, not alarm)
    for kind in KINDS:
        if counted[kind]:
            detected, named = np.array(counted[kind]).mean(axis=0)
            print(f"{kind:10} {len(counted[kind]):3} faults: detected {detected:6.1%}, rightly named {named:6.1%}")
    every = np.array([one for kind in KINDS for one in counted[kind]])
    print(
        f"all        {len(every):3} faults: detected {every[:, 0].mean():.1%}, rightly named {every[:, 1].mean():.1%}"
    )
    print(f"too small to count: {len(small)}, of which {sum(small)} detected")
    print(f"sound      {sound_count:3}: {alarms} false alarms ({alarms / max(sound_count, 1):.1%})")
    print(f"time per check: median {np.median(took):.2f} s, longest {max(took):.2f} s")


def _disturbed(rng: np.random.Generator) -> dict[str, Any]:
    return {
        "sensor": "d435i" if rng.random() < 0.8 else "exact",
        "drift": 0.01 if rng.random() < 0.7 else 0.0,
        "moving": bool(rng.random() < 0.4),
    }


def _judged(made: Recording) -> tuple[Verdict, Evidence, float]:
    begin = time.perf_counter()
    evidence = gather(made.sequence)
    assert evidence is not None, "a simulated recording can be read"
    verdict = find_faults(evidence, depth_unit_m=made.sequence.depth_unit_m, up="z")
    return verdict, evidence, time.perf_counter() - begin


def _is_named(verdict: Verdict, made: Recording) -> bool:
    """Whether the first finding, and no other, is the fault, with its value."""
    if [finding.kind for finding in verdict.findings] != [made.fault]:
        return False
    found, true = verdict.correction, made.expected
    same = (found.convention, found.axes, found.mirrored, found.ray_depth, found.up) == (
        true.convention,
        true.axes,
        true.mirrored,
        true.ray_depth,
        true.up,
    )
    times = [(found.time_offset_s, true.time_offset_s), (found.colour_offset_s, true.colour_offset_s)]
    interval_s = made.sequence.frames[1].time_s - made.sequence.frames[0].time_s
    same = same and all(abs(one - other) < max(0.02, 0.4 * interval_s) for one, other in times)
    factors = [
        (found.pose_scale, true.pose_scale),
        (found.depth_scale, true.depth_scale),
        (found.focal_scale, true.focal_scale),
    ]
    return same and all(abs(np.log(one / other)) < 0.1 for one, other in factors)


def _print(
    number: int, walk: Walk, made: Recording, verdict: Verdict, size: float, detected: bool, named: bool
) -> None:
    said = "; ".join(f"{finding.kind} {finding.correction.changes()}" for finding in verdict.findings) or "nothing"
    print(
        f"{number:4} {walk.name:14} {made.fault or 'sound':9} {made.size:15} moves {size:7.3f}"
        f" {'detected' if detected else 'missed':8} {'right' if named else 'WRONG':5} says {said}"
        f" (fits {verdict.stated.fitting:.2f} -> {verdict.corrected.fitting:.2f})"
    )


if __name__ == "__main__":
    run_script(main)
