"""The tables of a comparison in Markdown: means, deviations and intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from anm_mj.bench.best_known import BEST
from anm_mj.bench.result import USUAL, variant
from anm_mj.bench.statistics import LEAST_SCENES, PairedDifference, bootstrap_interval, paired_difference
from anm_mj.planning.policies.registry import DEFAULT_POLICY, needs_truth

COLUMNS = (
    ("observable_ratio_auc", "AUC, observable [%]", 1),
    ("share_of_best_auc", "AUC of the best known [%]", 1),
    ("completion_ratio", "final ratio [%]", 1),
    ("completion_cm", "final completion [cm]", 2),
    ("observable_ratio", "final ratio, observable [%]", 1),
    ("completion_ratio_auc", "AUC [%]", 1),
    ("restricted_steps_to_90", "steps to 90 %, at most the budget", 0),
    ("path_m_to_90", "path to 90 % [m], at most the budget's", 1),
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
    ("path_m_to_90", "path to 90 % [m]", 1),
    ("path_m", "path [m]", 1),
)
"""Columns of the table of paired differences."""
_LEGEND = (
    "Numbers of a scene are mean ± standard deviation over starts and seeds; means over scenes have the 95 % interval "
    "of a bootstrap over scenes (three at least). (n/m): only n of m runs have it."
)


def markdown(rows: Sequence[dict[str, Any]], command: str) -> str:
    """Tables of means over scenes, of paired differences, and one per scene; each for every budget of the comparison.

    Entries of a scene are mean ± standard deviation over starts and seeds; means over scenes have the 95 % interval of
    a bootstrap over them. (n/m) marks entries that only n of m runs have, such as the steps to a ratio that not all
    runs reached.

    Args:
        rows: Of :func:`~anm_mj.bench.results_table.tidy_rows`.
        command: The command that made them.
    """
    parts = [f"Made by `{command}`, revision {_revisions(rows)}, from {_num_runs(rows)} runs. {_LEGEND}"]
    parts += [part for by in _budgets(rows) for part in _overall([row for row in rows if row["budget_by"] == by], by)]
    parts += [part for scene in _unique(rows, "scene") for part in _scene([r for r in rows if r["scene"] == scene])]
    return "\n\n".join(parts) + "\n"


def _unique(rows: Sequence[dict[str, Any]], key: str) -> list[Any]:
    return list(dict.fromkeys(row[key] for row in rows))


def _budgets(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Names of the budgets; one empty name where there is one budget only."""
    return _unique(rows, "budget_by")


def _num_runs(rows: Sequence[dict[str, Any]]) -> int:
    """Number of runs; one that is cut at two budgets has two rows."""
    keys = ("scene", "policy", "start", "seed", "revision", *USUAL, "settings")
    return len({tuple(row[key] for key in keys) for row in rows})


def _revisions(rows: Sequence[dict[str, Any]]) -> str:
    """The revision of all rows, or a warning that they have several."""
    revisions = sorted({row["revision"] for row in rows})
    if len(revisions) == 1:
        return revisions[0]
    return f"{', '.join(revisions)} (**rows of several revisions do not compare**)"


def _title(text: str, by: str) -> str:
    return f"## {text}, budget by {by}" if by else f"## {text}"


def _overall(rows: Sequence[dict[str, Any]], by: str) -> list[str]:
    """Means over the scenes that variants have in common, and the differences between variants."""
    variants = list(dict.fromkeys(variant(row) for row in rows))
    scenes = {name: frozenset(row["scene"] for row in rows if variant(row) == name) for name in variants}
    parts = []
    # One table for every set of scenes that some variant has run in: the more variants, the fewer scenes they share.
    for common in sorted(dict.fromkeys(scenes.values()), key=lambda some: -len(some)):
        names = [name for name in variants if scenes[name] >= common]
        if len(common) > 1:
            # The mean over scenes of each scene's mean, as in the paper's tables.
            ordered = [scene for scene in _unique(rows, "scene") if scene in common]
            groups = [(name, [_mean_row(rows, scene, name) for scene in ordered]) for name in names]
            text = f"Over {', '.join(ordered)}."
            parts += [_title(f"Mean over {len(ordered)} scenes", by), text, _table(groups, over_scenes=True)]
    if any(row["best_known_auc"] is not None for row in rows):
        parts.append(_bounds(rows, by))
    if len(variants) > 1:
        reference = next((name for name in variants if name == DEFAULT_POLICY), variants[0])
        parts.append(_differences(rows, variants, reference, by))
    return parts


def _bounds(rows: Sequence[dict[str, Any]], by: str) -> str:
    """Between what the optimum lies in each scene."""
    lines = [
        _title("What is possible", by),
        "",
        "Share of the observable surface: the best of all runs from the same start, the oracle's among them, and what "
        "no tour can exceed. Means over starts; in how many of them a policy's run was better than the oracle's tours.",
        "",
        "| scene | AUC, best known [%] | AUC, at most [%] | by a policy | final, best known [%] | final, at most [%] | "
        "by a policy |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    for scene in _unique(rows, "scene"):
        known = [row for row in rows if row["scene"] == scene and row["best_known_auc"] is not None]
        # One of the rows of every start and apparatus: all say the same about it.
        here = list(
            {tuple(row[key] for key in ("start", "robot", "drive", "pose", "sensor")): row for row in known}.values()
        )
        if not here:
            continue
        cells = [scene]
        for name in BEST:
            best, most = (_numbers(here, f"{kind}_{name}") for kind in ("best_known", "upper_bound"))
            by_policy = sum(not needs_truth(row[f"best_known_{name}_by"].partition(" ")[0]) for row in here)
            cells += [f"{best.mean():.1f}", f"{most.mean():.1f}" if len(most) else "–", f"{by_policy}/{len(here)}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _scene(rows: Sequence[dict[str, Any]]) -> list[str]:
    """The tables of one scene."""
    variants = list(dict.fromkeys(variant(row) for row in rows))
    parts = [f"## {rows[0]['scene']}"]
    for by in _budgets(rows):
        here = [row for row in rows if row["budget_by"] == by]
        budget = ", ".join(str(steps) for steps in sorted({row["budget"] for row in here}))
        reason = f" (by {by})" if by else ""
        parts.append(f"Scene hash {rows[0]['scene_hash'][:12]}, budget {budget} steps{reason}.")
        parts.append(_table([(name, [r for r in here if variant(r) == name]) for name in variants]))
    return parts


def _differences(rows: Sequence[dict[str, Any]], variants: Sequence[str], reference: str, by: str) -> str:
    """How much larger the numbers of one variant are than those of every other, pair by pair."""
    lines = [
        _title(f"{reference} against the others", by),
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


def _table(groups: Sequence[tuple[str, Sequence[dict[str, Any]]]], over_scenes: bool = False) -> str:
    """A row for each group; entries are means with deviations, or with intervals over scenes."""
    used = [column for column in COLUMNS if any(len(_numbers(rows, column[0])) for _, rows in groups)]
    lines = [
        "| policy | " + " | ".join(heading for _, heading, _ in used) + " |",
        "|---|" + "---:|" * len(used),
    ]
    for name, rows in groups:
        if rows:
            cells = [_cell(_numbers(rows, column), len(rows), decimals, over_scenes) for column, _, decimals in used]
            lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _cell(values: Float[np.ndarray, " n"], num_runs: int, decimals: int, over_scenes: bool) -> str:
    if len(values) == 0:
        return "–"
    text = f"{values.mean():.{decimals}f}"
    if over_scenes and len(values) >= LEAST_SCENES:
        low, high = bootstrap_interval(values)
        text += f" [{low:.{decimals}f}, {high:.{decimals}f}]"
    elif not over_scenes and len(values) > 1:
        text += f" ± {values.std(ddof=1):.{decimals}f}"
    return text if len(values) == num_runs else f"{text} ({len(values)}/{num_runs})"


def _numbers(rows: Sequence[dict[str, Any]], name: str) -> Float[np.ndarray, " n"]:
    """The finite numbers in a column."""
    values = np.array([row[name] for row in rows if row.get(name) is not None], float)
    return values[np.isfinite(values)]
