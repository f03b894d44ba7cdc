"""The report of a comparison: Markdown tables of means and deviations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from anm_mj.bench.results_table import variant
from anm_mj.bench.statistics import PairedDifference, paired_difference
from anm_mj.planning.policies.registry import DEFAULT_POLICY

COLUMNS = (
    ("observable_ratio_auc", "AUC, observable [%]", 1),
    ("completion_ratio", "final ratio [%]", 1),
    ("completion_cm", "final completion [cm]", 2),
    ("observable_ratio", "final ratio, observable [%]", 1),
    ("completion_ratio_auc", "AUC [%]", 1),
    ("restricted_steps_to_90", "steps to 90 %, at most the budget", 0),
    ("steps_to_90", "steps to 90 % where reached", 0),
    ("restricted_steps_to_95", "steps to 95 %, at most the budget", 0),
    ("steps_to_95", "steps to 95 % where reached", 0),
    ("steps_to_99", "steps to 99 % where reached", 0),
    ("oracle_ratio_90", "x oracle, 90 %", 2),
    ("oracle_ratio_95", "x oracle, 95 %", 2),
    ("steps", "steps", 0),
    ("path_m", "path [m]", 1),
    ("turns", "turns", 0),
    ("collisions", "collisions", 1),
    ("observed_f_score", "mesh F-score, observed [%]", 1),
    ("novel_view_psnr_db", "novel-view PSNR [dB]", 1),
    ("novel_view_ssim", "novel-view SSIM", 3),
    ("novel_view_depth_l1_cm", "novel-view depth L1 [cm]", 1),
    ("fixed_view_psnr_db", "fixed-view PSNR [dB]", 1),
    ("fixed_view_ssim", "fixed-view SSIM", 3),
    ("fixed_view_depth_error_cm", "fixed-view depth error [cm]", 2),
    ("hz", "steps/s", 1),
)
"""Column of the results table, heading, decimals."""
DIFFERENCES = (
    ("observable_ratio_auc", "AUC, observable [points]", 1),
    ("observable_ratio", "final ratio, observable [points]", 1),
    ("restricted_steps_to_90", "steps to 90 %", 0),
    ("path_m", "path [m]", 1),
)
"""Columns of the table of paired differences."""


def markdown(rows: Sequence[dict[str, Any]], command: str) -> str:
    """One table per scene, and one of means over the scenes that every policy has run in.

    Entries are mean ± standard deviation over starts and seeds. (n/m) marks entries that only n of m runs have, such as
    the steps to a ratio that not all runs reached.
    """
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    variants = list(dict.fromkeys(variant(row) for row in rows))
    revisions = ", ".join(sorted({row["revision"] or "unknown" for row in rows}))
    parts = [
        f"Made by `{command}`, revision {revisions}, from {len(rows)} runs. Numbers are mean ± standard deviation over "
        "starts and seeds; (n/m): only n of m runs have it."
    ]
    for scene in scenes:
        here = [row for row in rows if row["scene"] == scene]
        budget = ", ".join(str(steps) for steps in sorted({row["budget"] for row in here}))
        parts.append(f"## {scene}\n\nScene hash {here[0]['scene_hash'][:12]}, budget {budget} steps.")
        parts.append(_table([(name, [r for r in here if variant(r) == name]) for name in variants]))
    common = [s for s in scenes if {variant(r) for r in rows if r["scene"] == s} == set(variants)]
    if len(common) > 1:
        # The mean over scenes of each scene's mean, as in the paper's tables.
        groups = [(name, [_mean_row(rows, scene, name) for scene in common]) for name in variants]
        parts.append(f"## Mean over {len(common)} scenes\n\nDeviation between scenes: {', '.join(common)}.")
        parts.append(_table(groups))
    if len(variants) > 1:
        reference = next((name for name in variants if name == DEFAULT_POLICY), variants[0])
        parts.append(_differences(rows, variants, reference))
    return "\n\n".join(parts) + "\n"


def _differences(rows: Sequence[dict[str, Any]], variants: Sequence[str], reference: str) -> str:
    """How much larger the numbers of one variant are than those of every other, pair by pair."""
    lines = [
        f"## {reference} against the others",
        "",
        f"{reference} minus the other, over pairs of runs with the same scene, start, seed and budget: means of each "
        "scene's mean, with the 95 % interval of a bootstrap over scenes (three at least). A run that never reaches "
        "90 % counts with its budget.",
        "",
        "| against | scenes | pairs | " + " | ".join(heading for _, heading, _ in DIFFERENCES) + " |",
        "|---|---:|---:|" + "---:|" * len(DIFFERENCES),
    ]
    own = [row for row in rows if variant(row) == reference]
    for name in variants:
        other = [row for row in rows if variant(row) == name]
        found = [(paired_difference(own, other, column), decimals) for column, _, decimals in DIFFERENCES]
        first = next((difference for difference, _ in found if difference is not None), None)
        if name != reference and first is not None:
            cells = " | ".join(_difference(difference, decimals) for difference, decimals in found)
            lines.append(f"| {name} | {first.num_scenes} | {first.num_pairs} | {cells} |")
    return "\n".join(lines)


def _difference(difference: PairedDifference | None, decimals: int) -> str:
    if difference is None:
        return "–"
    text = f"{difference.mean:+.{decimals}f}"
    if difference.interval is None:
        return text
    low, high = difference.interval
    return f"{text} [{low:+.{decimals}f}, {high:+.{decimals}f}]"


def _mean_row(rows: Sequence[dict[str, Any]], scene: str, name: str) -> dict[str, Any]:
    here = [row for row in rows if row["scene"] == scene and variant(row) == name]
    means = {}
    for column, _, _ in COLUMNS:
        values = _numbers(here, column)
        means[column] = float(values.mean()) if len(values) else None
    return means


def _table(groups: Sequence[tuple[str, Sequence[dict[str, Any]]]]) -> str:
    used = [column for column in COLUMNS if any(len(_numbers(rows, column[0])) for _, rows in groups)]
    lines = [
        "| policy | " + " | ".join(heading for _, heading, _ in used) + " |",
        "|---|" + "---:|" * len(used),
    ]
    for name, rows in groups:
        if rows:
            cells = [_cell(_numbers(rows, column), len(rows), decimals) for column, _, decimals in used]
            lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _cell(values: Float[np.ndarray, " n"], num_runs: int, decimals: int) -> str:
    if len(values) == 0:
        return "–"
    text = f"{values.mean():.{decimals}f}"
    if len(values) > 1:
        text += f" ± {values.std(ddof=1):.{decimals}f}"
    return text if len(values) == num_runs else f"{text} ({len(values)}/{num_runs})"


def _numbers(rows: Sequence[dict[str, Any]], name: str) -> Float[np.ndarray, " n"]:
    """The finite numbers in a column."""
    values = np.array([row[name] for row in rows if row.get(name) is not None], float)
    return values[np.isfinite(values)]
