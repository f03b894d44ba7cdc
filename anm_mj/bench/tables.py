"""The tables of a comparison in Markdown: means, deviations and intervals."""

import math
from typing import Any

from anm_mj.bench.error_tables import PAIRED, POSE_COLUMNS, localisation_table, reality_table
from anm_mj.bench.job import CONDITIONS, PLATFORM, variant
from anm_mj.bench.markdown_table import DASH, Rows, difference_table, ended_by, heading, numbers, split_by
from anm_mj.bench.results_table import BEST
from anm_mj.bench.run_result import MOST_MISSING, split_settings
from anm_mj.bench.statistics import LEAST_SCENES, TASK, case
from anm_mj.planning.policies.registry import DEFAULT_POLICY, needs_truth
from anm_mj.utils.markdown import table

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
    *POSE_COLUMNS[PAIRED:],
)
"""Further columns of the tables of one scene."""
FEWEST = "times_fewest_90"
"""Column whose mean over scenes is over those that have a number, which are counted."""
FEW_RUNS = 4
"""With fewer runs than this, a variant that lacks one of them stands in another table of means."""
WORLD_SETTINGS = "world_settings"
"""Name of the settings of body, sensors and people among a row's settings."""
_LEGEND = f"""\
Means over scenes are of each scene's mean, over the runs that all rows of a table have in common. Numbers of one scene
are mean ± standard deviation over starts and seeds. (n/m): only n of m runs or scenes have the number. A run that never
reaches 90 % counts with its budget, and with the path that it allows.

Differences are over pairs of runs of the same scene, start, seed and budget: means of each scene's mean, with the 95 %
interval of a bootstrap over scenes ({LEAST_SCENES} at least). Of the AUC also: scenes in which the first is ahead, the
least and the largest mean without any one scene, and, for the policies as they come, the p value of Wilcoxon's
signed-rank test over scenes after Holm's correction for as many tests as the table shows; the oracle is not tested."""


def markdown(rows: Rows, command: str, num_jobs: int | None = None) -> str:
    """Tables of means over scenes, of paired differences, and one per scene; each for every budget of the comparison.

    Entries of a scene are mean ± standard deviation over starts and seeds. (n/m) marks entries that only n of m runs
    have, such as the steps to a ratio that not all runs reached. ``rows`` are those of
    :func:`~anm_mj.bench.results_table.tidy_rows`; ``num_jobs`` is the number of runs that the comparison asks for, None
    = as many as there are.
    """
    count = len(split_by(rows, "run"))
    runs = f"{count} run{'s' * (count != 1)}" if num_jobs in (None, count) else f"**{count} of {num_jobs}** runs"
    rows = [_with_derived(row) for row in rows]
    parts = [f"Made by `{command}`, revision {_revisions(rows)}, from {runs}.", _LEGEND]
    parts += [part for by, here in split_by(rows, "budget_by").items() for part in _overall(here, by)]
    parts += [part for scene, here in split_by(rows, "scene").items() for part in _scene(scene, here)]
    return "\n\n".join(parts) + "\n"


def _with_derived(row: dict[str, Any]) -> dict[str, Any]:
    """A row with its variant, what of its settings is of the world, and in per cent whether it reached the level."""
    steps = row.get("steps_to_90")
    reached = None if steps is None else 100.0 * math.isfinite(steps)
    world, _ = split_settings(row["settings"])
    return {**row, "variant": variant(row), WORLD_SETTINGS: " ".join(world), REACHED: reached}


def _revisions(rows: Rows) -> str:
    """The revision of all rows, or a warning that they have several."""
    revisions = sorted({row["revision"] for row in rows})
    if len(revisions) == 1:
        return revisions[0]
    return f"{', '.join(revisions)} (**rows of several revisions do not compare**)"


def _overall(rows: Rows, by: str) -> list[str]:
    """Means over the runs that variants have in common, and the differences between variants."""
    parts = []
    for common, names in _groups(rows):
        shared = [row for row in rows if case(row) in common]
        scenes = list(split_by(shared, "scene"))
        if len(scenes) > 1:
            text = f"Mean over {len(scenes)} scenes, {len(common)} runs of each policy"
            parts += [heading(text, by), f"Over {', '.join(scenes)}.", _means(shared, scenes, names)]
    if any(row["best_known_auc"] is not None for row in rows):
        parts.append(_bounds(rows, by))
    plainest = {policy: min(own, key=_unusual) for policy, own in split_by(rows, "policy").items()}
    first = plainest[DEFAULT_POLICY if DEFAULT_POLICY in plainest else rows[0]["policy"]]
    own = [row for row in rows if _without_platform(row) == _without_platform(first)]
    others = [row for row in rows if row["policy"] != first["policy"]]
    alike = "both in the same world, with the same robot, drive, pose, sensor and settings of these"
    text = f"{first['variant']} minus the other, {alike}."
    tested = {row["variant"] for policy, row in plainest.items() if not needs_truth(policy)}
    same = (*TASK, *PLATFORM, WORLD_SETTINGS)
    parts.append(difference_table(own, others, same, f"{first['variant']} against the others", text, by, tested))
    for policy, row in plainest.items():
        if needs_truth(policy):
            continue  # The oracle's tours have different aims.
        name = row["variant"]
        plain = [row for row in rows if row["variant"] == name]
        special = [row for row in rows if row["policy"] == policy and row["variant"] != name]
        title, text = f"{name} against its variants", f"{name} minus the variant."
        parts.append(difference_table(plain, special, TASK, title, text, by))
    parts += [reality_table(rows, by), localisation_table(rows, by)]
    return [part for part in parts if part]


def _groups(rows: Rows) -> list[tuple[set[tuple[Any, ...]], list[str]]]:
    """The tables of means: runs, and the variants that have all of them.

    The first table is of the variants that ran from about all starts, less those from which one of them failed; the
    others add variants that ran from fewer.
    """
    cases = {name: set(map(case, own)) for name, own in split_by(rows, "variant").items()}
    left = sorted(cases, key=lambda name: -len(cases[name]))
    groups = []
    while left:
        most = cases[left[0]]
        common: set[tuple[Any, ...]] = set()
        # Variants that each lack another run may have none in common: then those count that lack none.
        for missing in (max(MOST_MISSING * len(most), float(len(most) >= FEW_RUNS)), 0.0):
            common = common or most.intersection(*(cases[name] for name in left if len(most - cases[name]) <= missing))
        names = [name for name, own in cases.items() if own >= common]
        left = [name for name in left if name not in names]
        # A row alone compares with nothing.
        if len(names) > 1 or len(cases) == 1:
            groups.append((common, names))
    return groups


def _unusual(row: dict[str, Any]) -> tuple[int, int]:
    """How many settings of a row, and how many of its conditions, are not the defaults."""
    settings = sum(map(len, split_settings(row["settings"])))
    return settings, sum(row[key] != usual for key, usual in CONDITIONS.items())


def _without_platform(row: dict[str, Any]) -> str:
    """The variant of a row, were it of the default world, robot, drive, pose and sensor."""
    settings = " ".join(split_settings(row["settings"])[1])
    return variant({**row, **{key: CONDITIONS[key] for key in PLATFORM}, "settings": settings})


def _bounds(rows: Rows, by: str) -> str:
    """Between what the optimum lies in each scene."""
    text = (
        "Share of the observable surface: the best of all runs from the same start, the oracle's among them, and an "
        "estimated upper bound. Means over starts; from how many of them a policy found the best; "
        "and the most by which any run exceeded the bound at some step. The best known is that of these runs: "
        "shares of it do not compare with those of another comparison."
    )
    headings = ["scene"]
    for name in ("AUC", "final"):
        headings += [f"{name}, best known [%]", f"{name}, upper bound [%]", f"{name}, best by a policy"]
    lines = []
    for scene, known in split_by([row for row in rows if row["best_known_auc"] is not None], "scene").items():
        # One of the rows of every start and platform: all say the same about it.
        keys = ("start", "budget", *PLATFORM, WORLD_SETTINGS)
        here = list({case(row, keys): row for row in known}.values())
        cells = [scene]
        for name in BEST:
            best, most = (numbers(here, f"{kind}_{name}") for kind in ("best_known", "upper_bound"))
            by_policy = sum(not needs_truth(row[f"best_known_{name}_by"].partition(" ")[0]) for row in here)
            cells += [f"{best.mean():.1f}", f"{most.mean():.1f}" if len(most) else DASH, f"{by_policy}/{len(here)}"]
        exceeded = numbers(here, "upper_bound_exceeded_points")
        lines.append([*cells, f"{exceeded.max():.1f}" if len(exceeded) else DASH])
    headings.append("above the upper bound [points]")
    return "\n\n".join([heading("What is possible", by), text, table(headings, lines)])


def _scene(scene: str, rows: Rows) -> list[str]:
    """The tables of one scene: a row for each variant; entries are means with deviations."""
    parts = [f"## {scene}"]
    names = list(split_by(rows, "variant"))
    for by, here in split_by(rows, "budget_by").items():
        budget = ", ".join(map(str, sorted(split_by(here, "budget"))))
        reason = f" (by {by})" if by else ""
        parts.append(f"Scene hash {rows[0]['scene_hash'][:12]}, budget {budget} steps{reason}.")
        used = [column for column in (*MEANS, *OF_ONE_SCENE) if len(numbers(here, column[0]))]
        own = split_by(here, "variant")
        lines = [[name, *(_cell(own[name], *column) for column in used)] for name in names if name in own]
        parts.append(table(["policy", *(text for _, text, _ in used)], lines))
    return parts


def _cell(rows: Rows, column: str, _: str, decimals: int) -> str:
    """Mean, and deviation but of shares, over the runs of a scene that have a number."""
    values = numbers(rows, column)
    if len(values) == 0:
        return DASH
    text = f"{values.mean():.{decimals}f}"
    if column != REACHED and len(values) > 1:
        text += f" ± {values.std(ddof=1):.{decimals}f}"
    return text if len(values) == len(rows) else f"{text} ({len(values)}/{len(rows)})"


def _means(rows: Rows, scenes: list[str], names: list[str]) -> str:
    """The table of means over scenes of each scene's mean, and why runs ended."""
    variants = split_by(rows, "variant")
    means = {}
    for name in names:
        per_scene = split_by(variants[name], "scene")
        means[name] = [{column: _mean(per_scene[scene], column) for column, _, _ in MEANS} for scene in scenes]
    used = [column for column in MEANS if any(_mean_cell(own, *column) != DASH for own in means.values())]
    lines = [
        [name, *(_mean_cell(own, *column) for column in used), ended_by(variants[name])] for name, own in means.items()
    ]
    headings = ["policy", *(text for _, text, _ in used), "ended by"]
    return table(headings, lines, text_columns=(0, len(headings) - 1))


def _mean(rows: Rows, column: str) -> float | None:
    """Mean of the runs of a scene; None where one of them lacks the number.

    Of the fewest steps it is enough that an oracle ran from each start: starts from which no run arrives have none.
    """
    values = numbers(rows, column)
    has_oracle = len(numbers(rows, "best_known_auc")) == len(rows)
    enough = len(values) == len(rows) or (len(values) and column == FEWEST and has_oracle)
    return float(values.mean()) if enough else None


def _mean_cell(means: Rows, column: str, _: str, decimals: int) -> str:
    """Mean over scenes; a dash unless all have the number, or those that have it are counted."""
    values = numbers(means, column)
    if len(values) < (1 if column == FEWEST else len(means)):
        return DASH
    return f"{values.mean():.{decimals}f}" + f" ({len(values)}/{len(means)})" * (len(values) < len(means))
