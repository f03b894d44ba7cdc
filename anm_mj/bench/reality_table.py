"""The table of what the errors of the world cost a policy: one at a time, and all together."""

from typing import Any

import numpy as np

from anm_mj.bench.job import CONDITIONS, each_setting, variant
from anm_mj.bench.markdown_table import Rows, ended_by, heading, numbers, split_by, table, with_interval
from anm_mj.bench.statistics import LEAST_SCENES, TASK
from anm_mj.sim.simulation_config import IDEAL
from anm_mj.types import StopReason

ERRORS = ("sensor.", "model.wheel_noise=", "people.")
"""What the settings begin with that make the world harder."""
WORLD = ("reality", "sensor", "drive", "pose")
"""Conditions that do."""
FALSE_SHARE = 95.0
"""A run that ends before its budget with less than this share of the ideal run's coverage has ended falsely [%]."""
_TEXT = f"""\
What errors cost: runs beside those of the same policy, scene, start, seed and budget in the ideal world. Means of each
scene's mean, with the 95 % interval of a bootstrap over scenes ({LEAST_SCENES} at least); contacts, collisions and runs
are counted. A contact is a step by which the robot ran into somebody. A run that ended before its budget with less than
{FALSE_SHARE:g} % of the ideal run's coverage ended falsely."""
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


def reality_table(rows: Rows, by: str) -> str:
    """A row for each variant that differs from its policy's ideal runs by errors alone; empty without a real run.
    ``rows`` are those of the results table, with their ``variant``; ``by`` is the name of the budget.
    """
    if all(row["reality"] == IDEAL for row in rows):
        return ""
    ideal = {(_as_ideal(row), _task(row)): row for row in rows if row["variant"] == _as_ideal(row)[1]}
    lines = []
    for own in split_by(rows, "variant").values():
        if any(key[0] == _as_ideal(own[0]) for key in ideal):
            pairs = [(row, ideal.get((_as_ideal(row), _task(row)))) for row in own]
            lines.append(_line(pairs))
    return "\n\n".join([heading("What errors cost", by), _TEXT, table(_HEADINGS, lines, text_columns=(0, 13))])


def _as_ideal(row: dict[str, Any]) -> tuple[str, str]:
    """Policy and variant of a row, were it without errors."""
    settings = " ".join(one for one in each_setting(row["settings"]) if not one.startswith(ERRORS))
    return row["policy"], variant({**row, **{key: CONDITIONS[key] for key in WORLD}, "settings": settings})


def _task(row: dict[str, Any]) -> tuple[Any, ...]:
    return tuple(row[key] for key in TASK)


def _line(pairs: list[tuple[dict[str, Any], dict[str, Any] | None]]) -> list[str]:
    own = [row for row, _ in pairs]
    cells = [own[0]["variant"], str(len(split_by(own, "scene"))), str(len(own))]
    for column in ("observable_ratio", "observed_f_score"):
        known = [(row, row.get(column)) for row in own]
        shares = [(row, _share(row, other, column)) for row, other in pairs]
        cells += [_mean(known), _mean(shares, interval=True)]
    for column in ("people_contacts", "collisions"):
        counts = numbers(own, column)
        cells.append(f"{counts.sum():.0f}" if len(counts) else "–")
    cells.append(_mean([(row, row.get("lost_percent")) for row in own]))
    lost = sum(row.get("stop_reason") == StopReason.LOST for row in own)
    cells += [str(lost), str(sum(_is_false_end(row, other) for row, other in pairs))]
    cells.append(_mean([(row, row.get("hz")) for row in own]))
    return [*cells, ended_by(own)]


def _share(row: dict[str, Any], ideal: dict[str, Any] | None, column: str) -> float | None:
    """A number as a share of the ideal run's [%]."""
    if ideal is None or not row.get(column) or not ideal.get(column):
        return None
    return 100.0 * row[column] / ideal[column]


def _is_false_end(row: dict[str, Any], ideal: dict[str, Any] | None) -> bool:
    share = _share(row, ideal, "observable_ratio")
    is_early = row.get("stop_reason") not in (None, StopReason.BUDGET, StopReason.RETURNED, StopReason.INTERRUPTED)
    return is_early and share is not None and share < FALSE_SHARE


def _mean(values: list[tuple[dict[str, Any], float | None]], *, interval: bool = False) -> str:
    """Mean over scenes of each scene's mean over the runs that have a number."""
    by_scene: dict[str, list[float]] = {}
    for row, value in values:
        if value is not None and np.isfinite(value):
            by_scene.setdefault(row["scene"], []).append(value)
    means = np.array([np.mean(found) for found in by_scene.values()])
    if interval:
        return with_interval(means, ".1f")
    return f"{means.mean():.1f}" if len(means) else "–"
