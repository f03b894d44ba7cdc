"""The results table of a comparison: a row per run and budget, a column per fact.

Among them the best that is known to be possible, and an estimate of what is impossible, from each start. The oracle's
tours are good, not optimal. What counts as possible is therefore the best of all runs from the same start with the same
robot: no row beats it. :mod:`anm_mj.evaluation.oracle.upper_bound` estimates what no tour can exceed, so that the
optimum lies between the two. Both are known where an oracle has run.
"""

import csv
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from anm_mj.bench.job import PLATFORM
from anm_mj.bench.run_result import COMPLETION, OBSERVABLE, Result, split_settings
from anm_mj.bench.statistics import grouped, restricted_steps
from anm_mj.io.to_json import to_json
from anm_mj.planning.policies.registry import needs_truth
from anm_mj.utils.files import atomic_write

LEVELS = (90, 95, 99)
"""Levels of the observable completion ratio; the table has the steps to each [%]."""
BEST = ("auc", "final")
"""Measures that are bounded from both sides: area under the curve and final value of the observable ratio [%]."""


def tidy_rows(results: Sequence[Result]) -> list[dict[str, Any]]:
    """A row per run and budget, in the order of the results; every row has every column."""
    results = [cut for result in results for cut in result.cuts]
    known = best_known(results)
    rows = []
    for result in results:
        job, metrics = result.job, dict(result.metrics)
        best = known.get(situation(result), {})
        stage_hz = metrics.pop("stage_hz", None) or {}
        row = {
            "scene": job.scene_name,
            "scene_hash": job.scene_hash,
            "policy": job.policy,
            "start": job.start,
            "seed": job.seed,
            "revision": result.revision,
            **job.conditions,
            "settings": " ".join(job.settings),
            "run": result.folder.name,
            "budget": result.budget,
            "budget_by": result.budget_by,
            **metrics,
            "observable_ratio_auc": result.area_under_curve(OBSERVABLE),
            "completion_ratio_auc": result.area_under_curve(COMPLETION),
        }
        # Where the observable part is unknown, so is when it was covered.
        for level in LEVELS if np.isfinite(row["observable_ratio_auc"]) else ():
            steps = result.steps_to(level)
            row[f"steps_to_{level}"] = steps
            row[f"restricted_steps_to_{level}"] = restricted = restricted_steps(steps, result.budget)
            row[f"path_m_to_{level}"] = result.path_m_to(level)
            row[f"restricted_share_to_{level}"] = 100.0 * restricted / result.budget
            row[f"times_fewest_{level}"] = max(restricted, 1.0) / best.get(f"steps_to_{level}", np.nan)
        for key in BEST:
            row[f"best_known_{key}"] = best.get(key)
            row[f"best_known_{key}_by"] = best.get(f"{key}_by")
            row[f"upper_bound_{key}"] = best.get(f"bound_{key}")
        row["upper_bound_exceeded_points"] = best.get("bound_exceeded")
        row["share_of_best_auc"] = 100.0 * row["observable_ratio_auc"] / best.get("auc", np.nan)
        row |= {f"hz_{stage}": hz for stage, hz in stage_hz.items()}
        rows.append(row)
    columns = list(dict.fromkeys(key for row in rows for key in row))
    return [{column: row.get(column) for column in columns} for row in rows]


def situation(result: Result) -> tuple[Any, ...]:
    """What runs must share to be compared with one another's tours: all but what only concerns the map."""
    job = result.job
    world, _ = split_settings(" ".join(job.settings))
    return job.scene_name, job.start, result.budget, *(getattr(job, key) for key in PLATFORM), *world


def best_known(results: Sequence[Result]) -> Mapping[tuple[Any, ...], dict[str, Any]]:
    """Bounds of every situation in which an oracle has run.

    Returns:
        By :func:`situation`: ``auc`` and ``final``, the best of any run [%]; ``bound_auc`` and ``bound_final``, the
        upper bound [%]; ``bound_exceeded``, the most by which a run is above it at some step [points]; ``auc_by`` and
        ``final_by``, the variants of the best; and ``steps_to_90`` and so on, the fewest of any run, NaN where none
        gets there.
    """
    groups = grouped((situation(result), result) for result in results)
    return {key: _best(group) for key, group in groups.items() if any(needs_truth(r.job.policy) for r in group)}


def _best(group: Sequence[Result]) -> dict[str, Any]:
    auc = max(group, key=lambda result: result.area_under_curve(OBSERVABLE))
    final = max(group, key=lambda result: result.curve[-1, OBSERVABLE])
    best: dict[str, Any] = {"auc": auc.area_under_curve(OBSERVABLE), "final": float(final.curve[-1, OBSERVABLE])}
    best |= {"auc_by": auc.variant, "final_by": final.variant}
    for level in LEVELS:
        reached = [steps for result in group if np.isfinite(steps := result.steps_to(level))]
        # A level that the first view reaches takes no steps.
        best[f"steps_to_{level}"] = max(min(reached), 1.0) if reached else math.nan
    bounds = [bound for result in group if (bound := result.upper_bound()) is not None]
    if bounds:
        budget = group[0].budget
        steps, most = bounds[0].T
        over = [(run.curve[:, OBSERVABLE] - np.interp(run.curve[:, 0], steps, most)).max() for run in group]
        best["bound_exceeded"] = max(0.0, float(max(over)))
        # The estimate sees a sample of poses and of the surface; where a run saw more, it is what the run saw.
        best["bound_auc"] = max(float(np.trapezoid(most, steps) / budget), best["auc"])
        best["bound_final"] = max(float(most[-1]), best["final"])
    return best


def write_csv(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write rows; missing and non-finite values become empty cells."""
    with atomic_write(path) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(rows[0])
        for row in rows:
            writer.writerow("" if cell is None else cell for cell in json.loads(json.dumps(to_json(row))).values())
