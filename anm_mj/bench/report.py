"""The tables of a comparison in Markdown: means, deviations and intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from anm_mj.bench.best_known import BEST
from anm_mj.bench.result import USUAL, variant
from anm_mj.bench.statistics import (
    APPARATUS,
    LEAST_SCENES,
    TASK,
    PairedDifference,
    bootstrap_interval,
    holm,
    paired_difference,
)
from anm_mj.planning.policies.registry import DEFAULT_POLICY, needs_truth

COLUMNS = (
    ("observable_ratio_auc", "AUC, observable [%]", 1),
    ("share_of_best_auc", "AUC as a share of the best known [%]", 1),
    ("completion_ratio", "final ratio, all surface [%]", 1),
    ("completion_cm", "final completion [cm]", 2),
    ("observable_ratio", "final ratio, observable [%]", 1),
    ("completion_ratio_auc", "AUC, all surface [%]", 1),
    ("restricted_steps_to_90", "steps to 90 %, at most the budget", 0),
    ("restricted_share_to_90", "the same, of the budget [%]", 0),
    ("path_m_to_90", "path to 90 % [m], at most what the budget allows", 1),
    ("steps_to_90", "steps to 90 % where reached", 0),
    ("steps_to_95", "steps to 95 % where reached", 0),
    ("steps_to_99", "steps to 99 % where reached", 0),
    ("times_fewest_90", "times the fewest steps known to 90 %", 2),
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
WHERE_REACHED = ("steps_to_90", "steps_to_95", "steps_to_99", "times_fewest_90")
"""Columns whose mean is over those runs or scenes that have a number, which are counted."""
DIFFERENCES = (
    ("observable_ratio_auc", "AUC, observable [points]", 1),
    ("observable_ratio", "final ratio, observable [points]", 1),
    ("restricted_steps_to_90", "steps to 90 %", 0),
    ("restricted_share_to_90", "the same, of the budget [points]", 0),
    ("path_m_to_90", "path to 90 % [m]", 1),
    ("path_m", "path [m]", 1),
)
"""Columns of the table of paired differences."""
_LEGEND = (
    "Numbers of a scene are mean ± standard deviation over starts and seeds; means over scenes have the 95 % interval "
    f"of a bootstrap over scenes ({LEAST_SCENES} at least). (n/m): only n of a scene's m runs have it, or of m scenes."
)


def markdown(rows: Sequence[dict[str, Any]], command: str, num_jobs: int | None = None) -> str:
    """Tables of means over scenes, of paired differences, and one per scene; each for every budget of the comparison.

    Entries of a scene are mean ± standard deviation over starts and seeds; means over scenes have the 95 % interval of
    a bootstrap over them. (n/m) marks entries that only n of m runs have, such as the steps to a ratio that not all
    runs reached.

    Args:
        rows: Of :func:`~anm_mj.bench.results_table.tidy_rows`.
        command: The command that made them.
        num_jobs: Runs that the comparison asks for; None = as many as there are.
    """
    count = len(_unique(rows, "run"))
    runs = f"{count} run{'s' * (count != 1)}" if num_jobs in (None, count) else f"**{count} of {num_jobs}** runs"
    parts = [f"Made by `{command}`, revision {_revisions(rows)}, from {runs}. {_LEGEND}"]
    parts += [part for by in _budgets(rows) for part in _overall([row for row in rows if row["budget_by"] == by], by)]
    parts += [part for scene in _unique(rows, "scene") for part in _scene([r for r in rows if r["scene"] == scene])]
    return "\n\n".join(parts) + "\n"


def _unique(rows: Sequence[dict[str, Any]], key: str) -> list[Any]:
    return list(dict.fromkeys(row[key] for row in rows))


def _budgets(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Names of the budgets; one empty name where there is one budget only."""
    return _unique(rows, "budget_by")


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
    reference = DEFAULT_POLICY if DEFAULT_POLICY in _unique(rows, "policy") else rows[0]["policy"]
    plainest = _plainest(rows, reference)
    own = [row for row in rows if _with_apparatus(row, plainest) == variant(plainest)]
    others = [row for row in rows if row["policy"] != reference]
    text = f"{variant(plainest)} minus the other, both with the same robot, drive, pose and sensor"
    parts.append(_differences(own, others, (*TASK, *APPARATUS), f"{variant(plainest)} against the others", text, by))
    for policy in _unique(rows, "policy"):
        name = variant(_plainest(rows, policy))
        plain = [row for row in rows if variant(row) == name]
        special = [row for row in rows if row["policy"] == policy and variant(row) != name]
        text = f"{name} minus the variant"
        parts.append(_differences(plain, special, TASK, f"{name} against its variants", text, by))
    return [part for part in parts if part]


def _plainest(rows: Sequence[dict[str, Any]], policy: str) -> dict[str, Any]:
    """A row of the policy's first variant of those with the fewest settings and the least that is unusual."""

    def unusual(row: dict[str, Any]) -> tuple[int, int]:
        return len(row["settings"].split()), sum(row[key] != usual for key, usual in USUAL.items())

    return min((row for row in rows if row["policy"] == policy), key=unusual)


def _with_apparatus(row: dict[str, Any], other: dict[str, Any]) -> str:
    """Name of the variant that a row would have with the apparatus of another one."""
    return variant({**row, **{key: other[key] for key in APPARATUS}})


def _bounds(rows: Sequence[dict[str, Any]], by: str) -> str:
    """Between what the optimum lies in each scene."""
    lines = [
        _title("What is possible", by),
        "",
        "Share of the observable surface: the best of all runs from the same start, the oracle's among them, and a "
        "relaxation that estimates what no tour exceeds. Means over starts; in how many of them a policy's run was "
        "better than the oracle's tours; and the most by which any run was above the relaxation at some step.",
        "",
        "| scene | AUC, best known [%] | AUC, relaxed [%] | by a policy | final, best known [%] | final, relaxed [%] | "
        "by a policy | above the relaxation [points] |",
        "|---|---:|---:|---:|---:|---:|---:|---:|",
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
            best, most = (_numbers(here, f"{kind}_{name}") for kind in ("best_known", "relaxed"))
            by_policy = sum(not needs_truth(row[f"best_known_{name}_by"].partition(" ")[0]) for row in here)
            cells += [f"{best.mean():.1f}", f"{most.mean():.1f}" if len(most) else "–", f"{by_policy}/{len(here)}"]
        exceeded = _numbers(here, "relaxed_exceeded_points")
        cells.append(f"{exceeded.max():.1f}" if len(exceeded) else "–")
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


def _differences(
    own: Sequence[dict[str, Any]],
    others: Sequence[dict[str, Any]],
    same: Sequence[str],
    title: str,
    text: str,
    by: str,
) -> str:
    """How much larger the numbers of one policy are than those of variants, pair by pair; empty without a pair.

    Args:
        own: Rows of the policy.
        others: Rows of the variants.
        same: Columns in which the runs of a pair agree.
        title: Of the table.
        text: What is subtracted from what.
        by: Name of the budget.
    """
    variants = list(dict.fromkeys(variant(row) for row in others))
    found = {}
    for name in variants:
        other = [row for row in others if variant(row) == name]
        differences = [paired_difference(own, other, column, same) for column, _, _ in DIFFERENCES]
        if differences[0] is not None:
            found[name] = differences
    if not found:
        return ""
    lines = [
        _title(title, by),
        "",
        f"{text}, over pairs of runs of the same scene, start, seed and budget: means of each scene's mean, with the "
        f"95 % interval of a bootstrap over scenes ({LEAST_SCENES} at least). A run that never reaches 90 % counts "
        "with its budget, and with the path that it allows. Of the AUC also: scenes in which it is ahead, the least "
        "and the largest mean without any one scene, and the p value of Wilcoxon's signed-rank test over scenes, after "
        "Holm's correction for the rows of the table.",
        "",
        "| against | scenes | pairs | ahead | without one | p | "
        + " | ".join(heading for _, heading, _ in DIFFERENCES)
        + " |",
        "|---|---:|---:|---:|---:|---:|" + "---:|" * len(DIFFERENCES),
    ]
    areas = [differences[0] for differences in found.values()]
    p_values = holm([None if area is None else area.p_value for area in areas])
    for (name, differences), area, p_value in zip(found.items(), areas, p_values, strict=True):
        assert area is not None  # Those without a pair were left out above.
        ahead = f"{int((area.by_scene > 0.0).sum())}/{len(area.by_scene)}"
        without = "–" if area.without_one is None else "{:+.1f} to {:+.1f}".format(*area.without_one)
        cells = [name, str(len(area.by_scene)), str(area.num_pairs), ahead, without, _p_value(p_value)]
        cells += [_difference(one, decimals) for one, (_, _, decimals) in zip(differences, DIFFERENCES, strict=True)]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _p_value(p_value: float | None) -> str:
    return "–" if p_value is None else "< 0.001" if p_value < 0.001 else f"{p_value:.3f}"


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
    used = [column for column in COLUMNS if any(_shows(rows, column[0], over_scenes) for _, rows in groups)]
    lines = [
        "| policy | " + " | ".join(heading for _, heading, _ in used) + " |",
        "|---|" + "---:|" * len(used),
    ]
    for name, rows in groups:
        if rows:
            cells = [
                _cell(_numbers(rows, column), len(rows), decimals, over_scenes, column in WHERE_REACHED)
                for column, _, decimals in used
            ]
            lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _shows(rows: Sequence[dict[str, Any]], column: str, over_scenes: bool) -> bool:
    """Whether a row of a table has something to say in a column."""
    count = len(_numbers(rows, column))
    return count == len(rows) > 0 if over_scenes and column not in WHERE_REACHED else count > 0


def _cell(values: Float[np.ndarray, " n"], num_runs: int, decimals: int, over_scenes: bool, counted: bool) -> str:
    """A number of a table.

    Args:
        values: Of the runs of a scene, or of the means of scenes.
        num_runs: How many there would be.
        decimals: Of the text.
        over_scenes: Whether they are means of scenes.
        counted: Whether the mean of some scenes means something; else there is none where not all have a number.
    """
    if len(values) == 0 or (over_scenes and len(values) < num_runs and not counted):
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
