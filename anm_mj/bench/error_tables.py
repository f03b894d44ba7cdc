"""The tables of runs in a world with errors: what these cost a policy, and by how much believed poses err."""

from typing import Any

import numpy as np

from anm_mj.bench.job import CONDITIONS, each_setting, variant
from anm_mj.bench.markdown_table import DASH, Rows, ended_by, heading, numbers, split_by, with_interval
from anm_mj.bench.run_result import split_settings
from anm_mj.bench.statistics import LEAST_SCENES, TASK, case, paired_difference, scene_means
from anm_mj.sim.simulation_config import IDEAL
from anm_mj.types import StopReason
from anm_mj.utils.markdown import table

ERRORS = ("sensor.", "model.wheel_noise=", "people.")
"""What the settings begin with that make the world harder."""
WORLD = ("reality", "sensor", "drive", "pose")
"""Conditions that do."""
FALSE_SHARE = 95.0
"""A run that ends before its budget with less than this share of the ideal run's coverage has ended falsely [%]."""
_ERRORS_COST = f"""\
What errors cost: runs beside those of the same policy, scene, start, seed and budget in the ideal world. Means of each
scene's mean, with the 95 % interval of a bootstrap over scenes ({LEAST_SCENES} at least); contacts, collisions and runs
are counted. A contact is a step by which the robot ran into somebody. A run that ended before its budget with less than
{FALSE_SHARE:g} % of the ideal run's coverage ended falsely. (n/m): only n of m runs have such an ideal run."""
_HEADINGS = (
    "policy",
    "scenes",
    "runs",
    "final ratio, observable [%]",
    "of the ideal run's [%]",
    "mesh F-score, observed [%]",
    "of the ideal run's [%]",
    "contacts",
    "collisions",
    "frames lost [%]",
    "runs lost",
    "false ends",
    "steps/s",
    "ended by",
)
RMSE = "position_rmse_cm"
POSE_COLUMNS = (
    ("observed_f_score", "mesh F-score, observed [%]", 1),
    ("observable_ratio", "final ratio, observable [%]", 1),
    (RMSE, "position RMSE [cm]", 2),
    ("ate_rmse_cm", "ATE RMSE [cm]", 2),
    ("final_position_error_cm", "position at the end [cm]", 2),
    ("final_heading_error_deg", "heading at the end [deg]", 2),
    ("lost_percent", "frames lost [%]", 1),
    ("unmapped_percent", "frames not mapped [%]", 1),
    ("loops_closed", "loops closed", 1),
)
"""Column of the results table, heading, decimals."""
PAIRED = 2
"""So many of them have runs with true poses, too."""
OF_THE_POSE = ("model.wheel_noise=", "sensor.odometry_", "localisation.")
"""What settings begin with that change nothing where poses are true."""
OTHER_SETTINGS = "other_settings"
SAME = (*TASK, "policy", *(key for key in CONDITIONS if key != "pose"), OTHER_SETTINGS)
"""Columns in which a run agrees with the one with true poses that it is compared with."""
_POSES_ERR = f"""\
Runs whose poses may err, with their errors; minus the runs with true poses that are the same otherwise, where there are
any. Means of each scene's mean, with the 95 % interval of a bootstrap over scenes ({LEAST_SCENES} at least)."""


def reality_table(rows: Rows, by: str) -> str:
    """A row for each variant that differs from its policy's ideal runs by errors alone; empty without a real run.
    ``rows`` are those of the results table, with their ``variant``; ``by`` is the name of the budget.
    """
    if all(row["reality"] == IDEAL for row in rows):
        return ""
    ideal = {(_as_ideal(row), case(row)): row for row in rows if row["variant"] == _as_ideal(row)[1]}
    lines = []
    for own in split_by(rows, "variant").values():
        if any(key[0] == _as_ideal(own[0]) for key in ideal):
            pairs = [(row, ideal.get((_as_ideal(row), case(row)))) for row in own]
            lines.append(_line(pairs))
    return "\n\n".join([heading("What errors cost", by), _ERRORS_COST, table(_HEADINGS, lines, text_columns=(0, 13))])


def _as_ideal(row: dict[str, Any]) -> tuple[str, str]:
    """Policy and variant of a row, were it without errors."""
    settings = " ".join(one for one in each_setting(row["settings"]) if not one.startswith(ERRORS))
    return row["policy"], variant({**row, **{key: CONDITIONS[key] for key in WORLD}, "settings": settings})


def _line(pairs: list[tuple[dict[str, Any], dict[str, Any] | None]]) -> list[str]:
    own = [row for row, _ in pairs]
    cells = [own[0]["variant"], str(len(split_by(own, "scene"))), str(len(own))]
    num_pairs = sum(other is not None for _, other in pairs)
    paired = f" ({num_pairs}/{len(own)})" * (num_pairs < len(own))
    for column in ("observable_ratio", "observed_f_score"):
        known = [(row, row.get(column)) for row in own]
        shares = [(row, _share(row, other, column)) for row, other in pairs]
        cells += [_mean(known), _mean(shares, interval=True) + paired]
    for column in ("people_contacts", "collisions"):
        counts = numbers(own, column)
        cells.append(f"{counts.sum():.0f}" if len(counts) else DASH)
    cells.append(_mean([(row, row.get("lost_percent")) for row in own]))
    lost = sum(row.get("stop_reason") == StopReason.LOST for row in own)
    cells += [str(lost), str(sum(_is_false_end(row, other) for row, other in pairs)) + paired]
    cells.append(_mean([(row, row.get("hz")) for row in own]))
    return [*cells, ended_by(own)]


def _share(row: dict[str, Any], ideal: dict[str, Any] | None, column: str) -> float | None:
    """A number as a share of the ideal run's [%]."""
    if ideal is None or row.get(column) is None or not ideal.get(column):
        return None
    return 100.0 * row[column] / ideal[column]


def _is_false_end(row: dict[str, Any], ideal: dict[str, Any] | None) -> bool:
    share = _share(row, ideal, "observable_ratio")
    is_early = row.get("stop_reason") not in (None, StopReason.BUDGET, StopReason.RETURNED, StopReason.INTERRUPTED)
    return is_early and share is not None and share < FALSE_SHARE


def _mean(values: list[tuple[dict[str, Any], float | None]], *, interval: bool = False) -> str:
    """Mean over scenes of each scene's mean over the runs that have a number."""
    known = [(row["scene"], value) for row, value in values if value is not None and np.isfinite(value)]
    means = scene_means([scene for scene, _ in known], [value for _, value in known])
    if interval:
        return with_interval(means, ".1f")
    return f"{means.mean():.1f}" if len(means) else DASH


def localisation_table(rows: Rows, by: str) -> str:
    """A row for each variant whose poses may err; empty without one. ``rows`` are those of the results table, with
    their ``variant``; ``by`` is the name of the budget.
    """
    rows = [{**row, OTHER_SETTINGS: _other_settings(row["settings"])} for row in rows]
    exact = [row for row in rows if row["pose"] == "true"]
    lines = []
    for name, own in split_by([row for row in rows if row.get(RMSE) is not None], "variant").items():
        scenes = split_by(own, "scene").values()
        cells = [name, str(len(scenes)), str(len(own))]
        for place, (column, _, decimals) in enumerate(POSE_COLUMNS):
            per_scene = [found.mean() for here in scenes if len(found := numbers(here, column))]
            cells.append(with_interval(np.array(per_scene), f".{decimals}f"))
            if place < PAIRED:
                pair = paired_difference(own, exact, column, SAME)
                cells.append(with_interval(np.zeros(0) if pair is None else pair.by_scene, f"+.{decimals}f"))
        lines.append([*cells, ended_by(own)])
    if not lines:
        return ""
    headings = ["policy", "scenes", "runs"]
    for place, (_, text, _) in enumerate(POSE_COLUMNS):
        headings += [text, "minus that with true poses [points]"] if place < PAIRED else [text]
    headings.append("ended by")
    text = table(headings, lines, text_columns=(0, len(headings) - 1))
    return "\n\n".join([heading("Localisation", by), _POSES_ERR, text])


def _other_settings(text: str) -> str:
    """Settings, as the results table has them, without those of the pose."""
    world, others = split_settings(text)
    return " ".join(one for one in (*world, *others) if not one.startswith(OF_THE_POSE))
