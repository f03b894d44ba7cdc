"""Measure what continuing a run costs and finds: the figures of docs/reliability.md.

    scripts/continue_figures.py OUT [--scenes home] [--steps 4000] [--policies gvg anm-s] [--seeds 0 1 2] [--houses 4 7]

For each scene, policy and seed: a whole run, its continuation, and half a run with its continuation, from where it
ended and from the scene's start. For each house: three pieces of furniture moved between two runs, the second of which
sees the whole house again, and what it marks against the true surfaces of both.
"""

from __future__ import annotations

import argparse
import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import KDTree

import anm_mj
from anm_mj.evaluation.completion import Coverage
from anm_mj.ground_truth.ground_truth import COVERED_M, GroundTruth
from anm_mj.io.read_run import Run, read_run
from anm_mj.planning.policies.frontier.frontier_policy import Frontier
from anm_mj.scene.generation.generate_scene import generate_scene

CHANGED_M = 0.1
"""Surface is truly gone or new where the other scene has none within this distance [m]."""
REACH_M = 0.1
"""A mark is right, and changed surface is found, within this distance [m]."""
NUM_MOVED = 3


class Uninformed(Frontier):
    """A policy that is not told of the prior run, so that it sees everything again."""

    def continue_from(self, prior: object, mapper: object) -> None:
        """Take nothing over."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--scenes", nargs="*", default=["home"])
    parser.add_argument("--steps", type=int, help="budget of the whole run (default: the scene's own)")
    parser.add_argument("--seeds", type=int, nargs="*", default=[0])
    parser.add_argument("--houses", type=int, nargs="*", default=[4])
    parser.add_argument("--preset", default="default")
    parser.add_argument("--policies", nargs="*", default=["gvg"])
    parser.add_argument("--goal", default="coverage")
    parsed = parser.parse_args()
    for scene, policy, seed in itertools.product(parsed.scenes, parsed.policies, parsed.seeds):
        folder = parsed.out / f"{Path(scene).name}-{policy}-{parsed.goal}-{seed}"
        options = {"policy": policy, "seed": seed, "preset": parsed.preset, "goal": parsed.goal}
        print(json.dumps(_halves(folder, scene, parsed.steps, options)), flush=True)
    for house in parsed.houses:
        print(json.dumps(_moved(parsed.out / f"house{house}", house, parsed.preset)), flush=True)


def _halves(out: Path, scene: str, budget: int | None, options: dict[str, Any]) -> dict[str, object]:
    """Steps of a whole run, of its continuation, and of half a run with what follows it."""
    whole = _explored(out / "whole", scene, steps=budget, **options)
    steps = whole.metrics["steps"]
    again = _explored(out / "again", scene, steps=budget, continue_from=out / "whole", **options)
    half = _explored(out / "half", scene, steps=steps // 2, **options)
    last = read_run(out / "half").frames[-1].pose
    there = last.x_m, last.y_m, float(np.degrees(last.yaw_rad))
    found = {"whole": _numbers(whole), "again": _numbers(again), "half": _numbers(half)}
    for name, start in (("rest", there), ("rest from the start", None)):
        rest = _explored(
            out / name.replace(" ", "-"), scene, steps=budget, continue_from=out / "half", start=start, **options
        )
        share = (half.metrics["steps"] + rest.metrics["steps"]) / steps
        found[name] = {**_numbers(rest), "steps of both to those of the whole": round(share, 3)}
    return {"scene": Path(scene).name, **options, **found}


def _moved(out: Path, house: int, preset: str) -> dict[str, object]:
    """Precision and recall of the marks after furniture has moved."""
    for name, moved in (("before", 0), ("after", NUM_MOVED)):
        if not (out / name / "scene.toml").is_file():
            generate_scene(out / name, 5, house, moved=moved)
    _explored(out / "first", str(out / "before"), preset=preset, goal="coverage")
    policy = f"{Path(__file__).stem}:{Uninformed.__name__}"
    second = _explored(
        out / "second", str(out / "after"), preset=preset, goal="coverage", policy=policy, continue_from=out / "first"
    )
    found = {kind: _judge(out, kind) for kind in ("gone", "new")}
    return {"house": house, "second": _numbers(second), **found, "pieces": _pieces(out)}


def _explored(folder: Path, scene: str, **options: Any) -> anm_mj.Exploration:
    """The run in a folder, made where it is not there yet."""
    if (folder / "metrics.json").is_file():
        return anm_mj.Exploration(folder, json.loads((folder / "metrics.json").read_text()))
    return anm_mj.explore_scene(scene, out=folder, device="cpu", **options)


def _numbers(run: anm_mj.Exploration) -> dict[str, Any]:
    names = ("steps", "stop_reason", "observable_ratio_before", "observable_ratio", "observed_accuracy_cm", "wall_s")
    return {name: round(value, 2) if isinstance(value := run.metrics.get(name), float) else value for name in names} | {
        "explored_mb": round((run.folder / "explored.safetensors").stat().st_size / 1e6, 1)
    }


def _judge(out: Path, kind: str) -> dict[str, object]:
    """Precision and recall of the marks of a kind, by voxels and by samples of the true surfaces."""
    samples = {name: GroundTruth.load(out / name / "ground_truth.npz").samples for name in ("first", "second")}
    holds, lacks = ("first", "second") if kind == "gone" else ("second", "first")
    away_m, _ = KDTree(samples[lacks]).query(samples[holds])
    changed = samples[holds][away_m > CHANGED_M]
    marks = _marks(out / "second", kind)
    near_m, _ = KDTree(samples[holds][away_m > CHANGED_M / 2]).query(marks)
    runs = {name: read_run(out / name) for name in ("first", "second")}
    known = _is_seen(runs[holds], changed) & _is_looked_through(runs[lacks], changed)
    found_m = KDTree(marks).query(changed[known])[0] if len(marks) else np.full(int(known.sum()), np.inf)
    return {
        "voxels": len(marks),
        "precision": round(float((near_m <= REACH_M).mean()), 3) if len(marks) else None,
        "samples": int(known.sum()),
        "recall": round(float((found_m <= REACH_M).mean()), 3) if known.any() else None,
    }


def _marks(folder: Path, kind: str) -> np.ndarray:
    """Centres of the voxels of all changes of a kind, world [m]."""
    kinds = [change["kind"] for change in json.loads((folder / "changes.json").read_text())["changes"]]
    with np.load(folder / "changes.npz") as file:
        mine = np.array([kinds[number] == kind for number in file["change"]], bool)
        return file["xyz_m"][mine]


def _is_seen(run: Run, points_m: np.ndarray) -> np.ndarray:
    """Which points lie on surface that a run saw."""
    coverage = Coverage(points_m)
    for frame in run.frames:
        coverage.add(run.depth_mm(frame), run.intrinsics, frame.T_true_camera)
    return coverage.distance_m < COVERED_M


def _is_looked_through(run: Run, points_m: np.ndarray) -> np.ndarray:
    """Which points a run saw something behind of, in three frames or more and within 5 m."""
    count = np.zeros(len(points_m), int)
    for frame in run.frames:
        depth_m = run.depth_mm(frame).astype(float) / 1e3
        T = frame.T_true_camera
        x, y, z = ((points_m - T[:3, 3]) @ T[:3, :3]).T
        k, (rows, cols) = run.intrinsics, depth_m.shape
        ahead = (z > 0.2) & (z < 5.0)
        safe = np.where(ahead, z, 1.0)
        col = np.floor((k.fx * x / safe + k.cx) * cols / k.width).astype(int)
        row = np.floor((k.fy * y / safe + k.cy) * rows / k.height).astype(int)
        inside = ahead & (col >= 0) & (col < cols) & (row >= 0) & (row < rows)
        count[inside] += depth_m[row[inside], col[inside]] > z[inside] + CHANGED_M
    return count >= 3


def _pieces(out: Path) -> dict[str, object]:
    """How many of the moved pieces are marked at both places, and how many marks belong to none."""
    moves = json.loads((out / "after" / "moved.json").read_text())["moved"]
    changes = json.loads((out / "second" / "changes.json").read_text())["changes"]
    places = {"gone": "from", "new": "to"}
    hit = [[_overlaps(change, move[places[change["kind"]]]["outline_xy_m"]) for move in moves] for change in changes]
    found = {}
    for kind in places:
        mine = [row for row, change in zip(hit, changes, strict=True) if change["kind"] == kind]
        found[kind] = sum(any(row[k] for row in mine) for k in range(len(moves)))
    return {"moved": len(moves), **found, "marks": len(changes), "marks of no piece": sum(not any(row) for row in hit)}


def _overlaps(change: dict[str, list[float]], outline_xy_m: list[list[float]]) -> bool:
    """Whether the box of a change touches the box about a piece."""
    corners = np.array(outline_xy_m)
    low, high = np.array(change["low_m"][:2]), np.array(change["high_m"][:2])
    return bool((low <= corners.max(axis=0) + 0.05).all() and (high >= corners.min(axis=0) - 0.05).all())


if __name__ == "__main__":
    main()
