"""The results table of a comparison: a row per run and budget, a column per fact."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from anm_mj.bench.best_known import BEST, LEVELS, best_known, situation
from anm_mj.bench.run_result import COMPLETION, OBSERVABLE, Result
from anm_mj.bench.statistics import restricted_steps
from anm_mj.io.to_json import to_json
from anm_mj.utils.files import atomic_write


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


def write_csv(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write rows; missing and non-finite values become empty cells."""
    with atomic_write(path) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(rows[0])
        for row in rows:
            writer.writerow("" if cell is None else cell for cell in json.loads(json.dumps(to_json(row))).values())
