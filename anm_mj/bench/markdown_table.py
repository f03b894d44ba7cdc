"""Tables in Markdown from rows of the results table, and that of paired differences between one policy and others."""

from collections import Counter
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from anm_mj.bench.statistics import LEAST_SCENES, PairedDifference, bootstrap_interval, grouped, holm, paired_difference
from anm_mj.utils.markdown import table

DASH = "–"
"""For a number that is not there."""
Rows = Sequence[dict[str, Any]]
"""Rows of :func:`~anm_mj.bench.results_table.tidy_rows`, or such means of them."""
DIFFERENCES = (
    ("observable_ratio_auc", "AUC, observable [points]", 1),
    ("observable_ratio", "final ratio, observable [points]", 1),
    ("restricted_steps_to_90", "steps to 90 %", 0),
    ("restricted_share_to_90", "steps to 90 %, of the budget [points]", 0),
    ("path_m_to_90", "path to 90 % [m]", 0),
)
"""Column of the results table, heading, decimals."""


def split_by(rows: Rows, column: str) -> dict[Any, list[dict[str, Any]]]:
    """The rows of each value of a column, in the order of their first appearance."""
    return grouped((row[column], row) for row in rows)


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


def difference_table(
    own: Rows, others: Rows, same: Sequence[str], title: str, text: str, by: str, tested: Collection[str] = ()
) -> str:
    """How much larger the numbers of one policy are than those of variants, pair by pair; empty without a pair.

    The runs of a pair agree in the columns ``same``. The text says what is subtracted from what, ``by`` is the name of
    the budget; the difference is tested for the variants ``tested``.
    """
    found = {}
    for name, other in split_by(others, "variant").items():
        differences = [paired_difference(own, other, column, same) for column, _, _ in DIFFERENCES]
        if differences[0] is not None:
            found[name] = differences
    if not found:
        return ""
    p_values = holm([differences[0].p_value if name in tested else None for name, differences in found.items()])
    lines = []
    for (name, differences), p_value in zip(found.items(), p_values, strict=True):
        area = differences[0]
        without = DASH if area.without_one is None else "{:+.1f} to {:+.1f}".format(*area.without_one)
        cells = [name, str(len(area.by_scene)), str(area.num_pairs), _ahead(area), without]
        cells += [_p_value(p_value)] if tested else []
        for one, (_, _, decimals) in zip(differences, DIFFERENCES, strict=True):
            cells.append(with_interval(np.zeros(0) if one is None else one.by_scene, f"+.{decimals}f"))
        lines.append(cells)
    headings = ["against", "scenes", "pairs", "ahead", "without one", *(["p"] if tested else [])]
    headings += [name for _, name, _ in DIFFERENCES]
    return "\n\n".join([heading(title, by), text, table(headings, lines)])


def _ahead(area: PairedDifference) -> str:
    """In how many scenes the first variant is ahead, and in how many both are level."""
    tied = int((area.by_scene == 0.0).sum())
    return f"{int((area.by_scene > 0.0).sum())}/{len(area.by_scene)}" + f", {tied} tied" * bool(tied)


def _p_value(p_value: float | None) -> str:
    return DASH if p_value is None else "< 0.001" if p_value < 0.001 else f"{p_value:.3f}"
