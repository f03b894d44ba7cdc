"""The tables of a comparison in Markdown: means, deviations and intervals."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from anm_mj.bench.best_known import BEST
from anm_mj.bench.run_result import MOST_MISSING, USUAL, split_settings, variant
from anm_mj.bench.statistics import (
    LEAST_SCENES,
    PLATFORM,
    TASK,
    PairedDifference,
    holm,
    paired_difference,
)
from anm_mj.planning.policies.registry import DEFAULT_POLICY, needs_truth

REACHED = "reached_90"
MEANS = (
    ("observable_ratio_auc", "AUC, observable [%]", 1),
    ("share_of_best_auc", "AUC as a share of the best known [%]", 1),
    ("observable_ratio", "final ratio, observable [%]", 1),
    ("completion_ratio", "final ratio, all surface [%]", 1),
    ("completion_cm", "final completion, each distance at most 1 m [cm]", 1),
    (REACHED, "runs that reach 90 % [%]", 0),
    ("restricted_steps_to_90", "steps to 90 %, at most the budget", 0),
    ("path_m_to_90", "path to 90 % [m], at most what the budget allows", 0),
    ("times_fewest_90", "times the fewest steps known to 90 %, at least", 2),
    ("path_m", "path [m]", 0),
    ("collisions", "collisions", 1),
    ("observed_f_score", "mesh F-score, observed [%]", 1),
    ("novel_view_psnr_db", "novel-view PSNR [dB]", 1),
    ("novel_view_ssim", "novel-view SSIM", 3),
    ("novel_view_depth_l1_cm", "novel-view depth L1 [cm]", 1),
    ("fixed_view_psnr_db", "fixed-view PSNR [dB]", 1),
    ("fixed_view_ssim", "fixed-view SSIM", 3),
    ("fixed_view_depth_error_cm", "fixed-view depth error [cm]", 2),
)
"""Column of the results table, heading, decimals, of the means over scenes."""
OF_ONE_SCENE = (
    ("steps_to_95", "steps to 95 % where reached", 0),
    ("steps_to_99", "steps to 99 % where reached", 0),
    ("completion_ratio_auc", "AUC, all surface [%]", 1),
    ("steps", "steps", 0),
    ("turns", "turns", 0),
    ("hz", "steps/s", 1),
)
"""Further columns of the tables of one scene."""
FEWEST = "times_fewest_90"
"""Column whose mean over scenes is over those that have a number, which are counted."""
FEW_RUNS = 4
"""With fewer runs than this, a variant that lacks one of them stands in another table of means."""
DIFFERENCES = (
    ("observable_ratio_auc", "AUC, observable [points]", 1),
    ("observable_ratio", "final ratio, observable [points]", 1),
    ("restricted_steps_to_90", "steps to 90 %", 0),
    ("restricted_share_to_90", "steps to 90 %, of the budget [points]", 0),
    ("path_m_to_90", "path to 90 % [m]", 0),
)
"""Columns of the table of paired differences."""
ROBOT_SETTINGS = "robot_settings"
"""Name of the settings of body and sensors among a row's settings."""
_LEGEND = f"""\
Means over scenes are of each scene's mean, over the runs that all rows of a table have in common. Numbers of one scene
are mean ± standard deviation over starts and seeds. (n/m): only n of m runs or scenes have the number. A run that never
reaches 90 % counts with its budget, and with the path that it allows.

Differences are over pairs of runs of the same scene, start, seed and budget: means of each scene's mean, with the 95 %
interval of a bootstrap over scenes ({LEAST_SCENES} at least). Of the AUC also: scenes in which the first is ahead, the
least and the largest mean without any one scene, and, for the policies as they come, the p value of Wilcoxon's
signed-rank test over scenes after Holm's correction for as many tests as the table shows; the oracle is not tested."""


def markdown(rows: Sequence[dict[str, Any]], command: str, num_jobs: int | None = None) -> str:
    """Tables of means over scenes, of paired differences, and one per scene; each for every budget of the comparison.

    Entries of a scene are mean ± standard deviation over starts and seeds. (n/m) marks entries that only n of m runs
    have, such as the steps to a ratio that not all runs reached.

    Args:
        rows: Of :func:`~anm_mj.bench.results_table.tidy_rows`.
        command: The command that made them.
        num_jobs: Runs that the comparison asks for; None = as many as there are.
    """
    count = len(_unique(rows, "run"))
    runs = f"{count} run{'s' * (count != 1)}" if num_jobs in (None, count) else f"**{count} of {num_jobs}** runs"
    rows = [
        {
            **row,
            REACHED: _reached(row.get("steps_to_90")),
            ROBOT_SETTINGS: " ".join(split_settings(row["settings"])[0]),
        }
        for row in rows
    ]
    parts = [f"Made by `{command}`, revision {_revisions(rows)}, from {runs}.", _LEGEND]
    parts += [part for by in _budgets(rows) for part in _overall([row for row in rows if row["budget_by"] == by], by)]
    parts += [part for scene in _unique(rows, "scene") for part in _scene([r for r in rows if r["scene"] == scene])]
    return "\n\n".join(parts) + "\n"


def _reached(steps: float | None) -> float | None:
    """Whether a run got to a level, in per cent, so that means are shares; None where it is unknown."""
    return None if steps is None else 100.0 * math.isfinite(steps)


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
    """Means over the runs that variants have in common, and the differences between variants."""
    parts = []
    for common, names in _groups(rows):
        shared = [row for row in rows if _case(row) in common]
        scenes = _unique(shared, "scene")
        if len(scenes) > 1:
            text = f"Mean over {len(scenes)} scenes, {len(common)} runs of each policy"
            parts += [_title(text, by), f"Over {', '.join(scenes)}.", _means(shared, scenes, names)]
    if any(row["best_known_auc"] is not None for row in rows):
        parts.append(_bounds(rows, by))
    reference = DEFAULT_POLICY if DEFAULT_POLICY in _unique(rows, "policy") else rows[0]["policy"]
    plainest = {policy: _plainest(rows, policy) for policy in _unique(rows, "policy")}
    name = variant(plainest[reference])
    own = [row for row in rows if _same_but_for_platform(row, plainest[reference])]
    others = [row for row in rows if row["policy"] != reference]
    text = f"{name} minus the other, both with the same robot, drive, pose, sensor and settings of these."
    tested = {variant(row) for policy, row in plainest.items() if not needs_truth(policy)}
    parts.append(
        _differences(own, others, (*TASK, *PLATFORM, ROBOT_SETTINGS), f"{name} against the others", text, by, tested)
    )
    for policy, row in plainest.items():
        if needs_truth(policy):
            continue  # The oracle's tours have different aims.
        name = variant(row)
        plain = [row for row in rows if variant(row) == name]
        special = [row for row in rows if row["policy"] == policy and variant(row) != name]
        title, text = f"{name} against its variants", f"{name} minus the variant."
        parts.append(_differences(plain, special, TASK, title, text, by))
    return [part for part in parts if part]


def _groups(rows: Sequence[dict[str, Any]]) -> list[tuple[set[tuple[Any, ...]], list[str]]]:
    """The tables of means: runs, and the variants that have all of them.

    The first table is of the variants that ran from about all starts, less those from which one of them failed; the
    others add variants that ran from fewer.
    """
    cases: dict[str, set[tuple[Any, ...]]] = {}
    for row in rows:
        cases.setdefault(variant(row), set()).add(_case(row))
    left = sorted(cases, key=lambda name: -len(cases[name]))
    groups = []
    while left:
        most = cases[left[0]]
        missing = max(MOST_MISSING * len(most), float(len(most) >= FEW_RUNS))
        common = most.intersection(*(cases[name] for name in left if len(most - cases[name]) <= missing))
        names = [name for name, own in cases.items() if own >= common]
        left = [name for name in left if name not in names]
        # A row alone compares with nothing.
        if len(names) > 1 or len(cases) == 1:
            groups.append((common, names))
    return groups


def _case(row: dict[str, Any]) -> tuple[Any, ...]:
    """What the runs of two variants share that compare."""
    return tuple(row[key] for key in TASK)


def _plainest(rows: Sequence[dict[str, Any]], policy: str) -> dict[str, Any]:
    """A row of the policy's first variant of those with the fewest settings and the least that is unusual."""

    def unusual(row: dict[str, Any]) -> tuple[int, int]:
        return sum(map(len, split_settings(row["settings"]))), sum(row[key] != usual for key, usual in USUAL.items())

    return min((row for row in rows if row["policy"] == policy), key=unusual)


def _same_but_for_platform(row: dict[str, Any], other: dict[str, Any]) -> bool:
    """Whether two rows are of one variant, were they of the same robot, drive, pose and sensor."""

    def name(of: dict[str, Any]) -> str:
        settings = " ".join(split_settings(of["settings"])[1])
        return variant({**of, **{key: USUAL[key] for key in PLATFORM}, "settings": settings})

    return name(row) == name(other)


def _bounds(rows: Sequence[dict[str, Any]], by: str) -> str:
    """Between what the optimum lies in each scene."""
    lines = [
        _title("What is possible", by),
        "",
        "Share of the observable surface: the best of all runs from the same start, the oracle's among them, and an "
        "estimated upper bound. Means over starts; from how many of them a policy found the best; "
        "and the most by which any run exceeded the bound at some step. The best known is that of these runs: "
        "shares of it do not compare with those of another comparison.",
        "",
        "| scene | AUC, best known [%] | AUC, upper bound [%] | AUC, best by a policy | final, best known [%] | "
        "final, upper bound [%] | final, best by a policy | above the upper bound [points] |",
        "|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for scene in _unique(rows, "scene"):
        known = [row for row in rows if row["scene"] == scene and row["best_known_auc"] is not None]
        # One of the rows of every start and platform: all say the same about it.
        here = list(
            {tuple(row[key] for key in ("start", "budget", *PLATFORM, ROBOT_SETTINGS)): row for row in known}.values()
        )
        if not here:
            continue
        cells = [scene]
        for name in BEST:
            best, most = (_numbers(here, f"{kind}_{name}") for kind in ("best_known", "upper_bound"))
            by_policy = sum(not needs_truth(row[f"best_known_{name}_by"].partition(" ")[0]) for row in here)
            cells += [f"{best.mean():.1f}", f"{most.mean():.1f}" if len(most) else "–", f"{by_policy}/{len(here)}"]
        exceeded = _numbers(here, "upper_bound_exceeded_points")
        cells.append(f"{exceeded.max():.1f}" if len(exceeded) else "–")
        lines.append(_line(cells))
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
    tested: Collection[str] = (),
) -> str:
    """How much larger the numbers of one policy are than those of variants, pair by pair; empty without a pair.

    Args:
        own: Rows of the policy.
        others: Rows of the variants.
        same: Columns in which the runs of a pair agree.
        title: Of the table.
        text: What is subtracted from what.
        by: Name of the budget.
        tested: Variants whose difference is tested.
    """
    found = {}
    for name in dict.fromkeys(variant(row) for row in others):
        other = [row for row in others if variant(row) == name]
        differences = [paired_difference(own, other, column, same) for column, _, _ in DIFFERENCES]
        if differences[0] is not None:
            found[name] = differences
    if not found:
        return ""
    p_values = holm([differences[0].p_value if name in tested else None for name, differences in found.items()])
    headings = ["against", "scenes", "pairs", "ahead", "without one", "p", *(heading for _, heading, _ in DIFFERENCES)]
    table = []
    for (name, differences), p_value in zip(found.items(), p_values, strict=True):
        area = differences[0]
        without = "–" if area.without_one is None else "{:+.1f} to {:+.1f}".format(*area.without_one)
        cells = [name, str(len(area.by_scene)), str(area.num_pairs), _ahead(area), without, _p_value(p_value)]
        cells += [_difference(one, decimals) for one, (_, _, decimals) in zip(differences, DIFFERENCES, strict=True)]
        table.append(cells)
    if not tested:
        del headings[5]
        for cells in table:
            del cells[5]
    lines = [_title(title, by), "", text, "", _line(headings), "|---|" + "---:|" * (len(headings) - 1)]
    return "\n".join(lines + [_line(cells) for cells in table])


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _ahead(area: PairedDifference) -> str:
    """In how many scenes the first variant is ahead, and in how many both are level."""
    tied = int((area.by_scene == 0.0).sum())
    return f"{int((area.by_scene > 0.0).sum())}/{len(area.by_scene)}" + f", {tied} tied" * bool(tied)


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


def _means(rows: Sequence[dict[str, Any]], scenes: Sequence[str], names: Sequence[str]) -> str:
    """The table of means over scenes of each scene's mean, and why runs ended."""
    groups = []
    for name in names:
        own = [row for row in rows if variant(row) == name]
        per_scene = [[row for row in own if row["scene"] == scene] for scene in scenes]
        groups.append((name, own, [{column: _mean(here, column) for column, _, _ in MEANS} for here in per_scene]))
    used = [
        column
        for column in MEANS
        if any(len(_numbers(means, column[0])) >= _least(means, column[0]) for _, _, means in groups)
    ]
    headings = ["policy", *(heading for _, heading, _ in used), "ended by"]
    lines = [_line(headings), "|---|" + "---:|" * len(used) + "---|"]
    for name, own, means in groups:
        cells = []
        for column, _, decimals in used:
            values = _numbers(means, column)
            enough = len(values) >= _least(means, column)
            count = f" ({len(values)}/{len(means)})" * (len(values) < len(means))
            cells.append(f"{values.mean():.{decimals}f}{count}" if enough else "–")
        reasons = Counter(row["stop_reason"] for row in own if row.get("stop_reason")).most_common()
        lines.append(_line([name, *cells, ", ".join(f"{reason} {count}" for reason, count in reasons)]))
    return "\n".join(lines)


def _mean(rows: Sequence[dict[str, Any]], column: str) -> float | None:
    """Mean of the runs of a scene; None where one of them lacks the number."""
    values = _numbers(rows, column)
    enough = len(values) == len(rows) or (len(values) and column == FEWEST)
    return float(values.mean()) if enough else None


def _least(means: Sequence[dict[str, Any]], column: str) -> int:
    """How many scenes must have a number for their mean to say something: all, unless they are counted."""
    return 1 if column == FEWEST else len(means)


def _table(groups: Sequence[tuple[str, Sequence[dict[str, Any]]]]) -> str:
    """A row for each variant's runs in one scene; entries are means with deviations."""
    used = [column for column in (*MEANS, *OF_ONE_SCENE) if any(len(_numbers(rows, column[0])) for _, rows in groups)]
    lines = [_line(["policy", *(heading for _, heading, _ in used)]), "|---|" + "---:|" * len(used)]
    for name, rows in groups:
        if rows:
            cells = [
                _cell(_numbers(rows, column), len(rows), decimals, column != REACHED) for column, _, decimals in used
            ]
            lines.append(_line([name, *cells]))
    return "\n".join(lines)


def _cell(values: Float[np.ndarray, " n"], num_runs: int, decimals: int, spread: bool) -> str:
    """Mean, and deviation if asked for, over the runs of a scene that have a number."""
    if len(values) == 0:
        return "–"
    text = f"{values.mean():.{decimals}f}"
    if spread and len(values) > 1:
        text += f" ± {values.std(ddof=1):.{decimals}f}"
    return text if len(values) == num_runs else f"{text} ({len(values)}/{num_runs})"


def _numbers(rows: Sequence[dict[str, Any]], name: str) -> Float[np.ndarray, " n"]:
    """The finite numbers in a column."""
    values = np.array([row[name] for row in rows if row.get(name) is not None], float)
    return values[np.isfinite(values)]
