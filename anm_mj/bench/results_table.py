"""The results table of a comparison: a row per run, a column per fact."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from anm_mj.bench.engine import RESULT
from anm_mj.bench.job import Job
from anm_mj.bench.statistics import restricted_steps
from anm_mj.bench.sweep import BenchError
from anm_mj.evaluation.metrics import read_metrics
from anm_mj.io.read_run import read_json
from anm_mj.io.to_json import to_json
from anm_mj.planning.policies.context import DEFAULT_GOAL
from anm_mj.planning.policies.registry import needs_truth
from anm_mj.robot.config import DEFAULT_ROBOT
from anm_mj.utils.files import atomic_write

USUAL = {
    "preset": "default",
    "robot": DEFAULT_ROBOT,
    "drive": "kinematic",
    "pose": "true",
    "sensor": "exact",
    "goal": DEFAULT_GOAL,
}
"""What variant names leave out, and what runs had before there was a choice."""
COMPLETION, OBSERVABLE = 1, 3
"""Columns of a curve: completion ratio, and completion ratio of the observable surface."""
LEVELS = (90, 95, 99)
"""Levels of the observable completion ratio; the table has the steps to each [%]."""


@dataclass(frozen=True)
class Result:
    """A finished run."""

    job: dict[str, Any]
    """Fields of :class:`~anm_mj.bench.job.Job`."""
    metrics: dict[str, Any]
    revision: str
    """Git revision; ends in ``+`` if the checkout had changes."""
    curve: Float[np.ndarray, "n 4"]
    """Step, completion ratio [%], completion [cm], observable ratio [%] (NaN where unknown)."""

    @property
    def variant(self) -> str:
        """Policy, with preset, robot, drive, pose, sensor, goal and settings if these are not the defaults."""
        return variant({**self.job, **self.apparatus, "settings": " ".join(self.job["settings"])})

    @property
    def apparatus(self) -> dict[str, str]:
        """Preset, robot, drive, pose, sensor and goal."""
        return {key: self.job.get(key, usual) for key, usual in USUAL.items()}

    def steps_to(self, level: float) -> float:
        """First step of the curve at which the observable completion ratio reaches a level [%]; NaN if none."""
        reached = np.flatnonzero(self.curve[:, OBSERVABLE] >= level)
        return float(self.curve[reached[0], 0]) if len(reached) else float("nan")

    def area_under_curve(self, column: int) -> float:
        """Mean of a column of the curve over the budget; a run that ends early keeps its final value."""
        budget = self.job["steps"]
        steps, values = np.append(self.curve[:, 0], budget), np.append(self.curve[:, column], self.curve[-1, column])
        return float(np.trapezoid(values, steps) / budget)


def variant(row: Mapping[str, Any]) -> str:
    """Name of a variant, such as ``anm-s (policy.target=random)``; its runs differ by start and seed.

    Args:
        row: Of the results table: ``policy``, the keys of ``USUAL``, and ``settings`` as one text.
    """
    special = [row[key] for key, usual in USUAL.items() if row[key] != usual]
    text = " ".join(text for text in (*special, row["settings"]) if text)
    return f"{row['policy']} ({text})" if text else row["policy"]


def read_result(folder: Path) -> Result:
    """A finished run of a comparison.

    Raises:
        RunFolderError: A file is damaged.
        BenchError: The curve holds no rows.
    """
    manifest = read_json(folder / "manifest.json") if (folder / "manifest.json").is_file() else {}
    git = manifest.get("git") or {}
    lines = (folder / "curve.csv").read_text(encoding="utf-8").splitlines()[1:]
    if not lines:
        raise BenchError(f"{folder / 'curve.csv'} holds no rows; delete {folder} and start again.")
    cells = [[float(cell) if cell else float("nan") for cell in line.split(",")[:4]] for line in lines]
    return Result(
        job=read_json(folder / RESULT),
        metrics=read_metrics(folder / "metrics.json"),
        revision=git.get("revision", "")[:12] + ("+" if git.get("changed") else ""),
        curve=np.array(cells),
    )


def finished(jobs: Sequence[Job], runs: Path) -> list[Job]:
    """The jobs whose runs exist."""
    return [job for job in jobs if (runs / job.name / RESULT).is_file()]


def tidy_rows(results: Sequence[Result]) -> list[dict[str, Any]]:
    """A row per run, in the order of the results; every row has every column."""
    oracle_steps = {
        (r.job["scene_name"], r.job["start"], *_seen_by(r), level): restricted_steps(r.steps_to(level), r.job["steps"])
        for r in results
        if needs_truth(r.job["policy"])
        for level in LEVELS
    }
    rows = []
    for result in results:
        job, metrics = result.job, dict(result.metrics)
        stage_hz = metrics.pop("stage_hz", None) or {}
        row = {
            "scene": job["scene_name"],
            "scene_hash": job["scene_hash"],
            "policy": job["policy"],
            "start": job["start"],
            "seed": job["seed"],
            "revision": result.revision,
            **result.apparatus,
            "settings": " ".join(job["settings"]),
            "budget": job["steps"],
            **metrics,
            "observable_ratio_auc": result.area_under_curve(OBSERVABLE),
            "completion_ratio_auc": result.area_under_curve(COMPLETION),
        }
        for level in LEVELS:
            steps = result.steps_to(level)
            row[f"steps_to_{level}"] = steps
            row[f"restricted_steps_to_{level}"] = restricted = restricted_steps(steps, job["steps"])
            oracle = oracle_steps.get((job["scene_name"], job["start"], *_seen_by(result), level), np.nan)
            row[f"oracle_ratio_{level}"] = restricted / oracle
        row |= {f"hz_{stage}": hz for stage, hz in stage_hz.items()}
        rows.append(row)
    columns = list(dict.fromkeys(key for row in rows for key in row))
    return [{column: row.get(column) for column in columns} for row in rows]


def _seen_by(result: Result) -> tuple[str, ...]:
    """What a run must share with the oracle's to be compared with it: all but what only concerns the map."""
    return tuple(value for key, value in result.apparatus.items() if key not in ("preset", "goal"))


def write_csv(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write rows; missing and non-finite values become empty cells."""
    with atomic_write(path) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(rows[0])
        for row in rows:
            writer.writerow("" if cell is None else cell for cell in json.loads(json.dumps(to_json(row))).values())
