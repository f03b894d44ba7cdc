"""How the variants of a comparison look in its figures: apart without colour, too."""

import textwrap
from typing import Any

from anm_mj.viz.figure_file import plain

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#7a3fa0", "#000000", "#b8860b", "#7b3f00", "#cc79a7", "#7f7f7f")
"""Apart for colour-blind eyes, after Okabe and Ito, Color Universal Design, 2008; one blue alone."""
LINES: tuple[Any, ...] = ("-", "--", "-.", (0, (1, 1)), (0, (5, 1, 1, 1, 1, 1)))
MARKS = ("o", "s", "^", "D", "v", "P", "X", "<", "*", "h", ">")
"""The lengths of the three have no common divisor, so that hundreds of variants differ."""

LINE_CHARACTERS = 34
MOST_LINES = 4


def style(k: int) -> dict[str, Any]:
    """Colour, line and mark of the variant of this number, as matplotlib takes them."""
    return {"color": COLOURS[k % len(COLOURS)], "ls": LINES[k % len(LINES)], "marker": MARKS[k % len(MARKS)]}


def legend_name(name: str) -> str:
    """A variant's name for a legend, in lines that leave room for the curves and no more than a few of them."""
    lines = textwrap.wrap(name, LINE_CHARACTERS, max_lines=MOST_LINES, placeholder=" ...")
    return plain("\n".join(lines))
