"""Tables in Markdown from rows of the results table."""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from anm_mj.bench.statistics import LEAST_SCENES, bootstrap_interval

DASH = "–"
"""For a number that is not there."""
Rows = Sequence[dict[str, Any]]
"""Rows of :func:`~anm_mj.bench.results_table.tidy_rows`, or such means of them."""


def split_by(rows: Rows, column: str) -> dict[Any, list[dict[str, Any]]]:
    """The rows of each value of a column, in the order of their first appearance."""
    found: dict[Any, list[dict[str, Any]]] = {}
    for row in rows:
        found.setdefault(row[column], []).append(row)
    return found


def numbers(rows: Rows, column: str) -> Float[np.ndarray, " n"]:
    """The finite numbers in a column."""
    values = np.array([row[column] for row in rows if row.get(column) is not None], float)
    return values[np.isfinite(values)]


def with_interval(by_scene: Float[np.ndarray, " scenes"], form: str) -> str:
    """Mean over scenes in a format such as ``.1f``, with its 95 % interval where they are enough; a dash for none."""
    if not len(by_scene):
        return DASH
    text = format(by_scene.mean(), form)
    if len(by_scene) < LEAST_SCENES:
        return text
    low, high = bootstrap_interval(by_scene)
    return f"{text} [{low:{form}}, {high:{form}}]"


def ended_by(rows: Rows) -> str:
    """Why runs ended, and how many of them, the most frequent reason first."""
    reasons = Counter(str(row["stop_reason"]) for row in rows if row.get("stop_reason")).most_common()
    return ", ".join(f"{reason} {count}" for reason, count in reasons)


def heading(text: str, by: str) -> str:
    """A heading for the budget of this name, which is empty where there is one budget only."""
    return f"## {text}, budget by {by}" if by else f"## {text}"


def table(headings: Sequence[str], lines: Iterable[Sequence[str]], *, text_columns: Sequence[int] = (0,)) -> str:
    """A table whose columns of numbers are aligned to the right."""
    alignment = "".join("---|" if k in text_columns else "---:|" for k in range(len(headings)))
    return "\n".join([_line(headings), f"|{alignment}", *map(_line, lines)])


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
