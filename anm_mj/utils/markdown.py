"""Tables in Markdown, without what a damaged installation may lack."""

from collections.abc import Iterable, Sequence

_BAR = r"\|"
"""A bar within a cell; another would begin the next one."""


def table(headings: Sequence[str], lines: Iterable[Sequence[str]], *, text_columns: Sequence[int] = (0,)) -> str:
    """A table whose columns of numbers are aligned to the right. Cells may hold anything but a line break."""
    alignment = "".join("---|" if k in text_columns else "---:|" for k in range(len(headings)))
    return "\n".join([_line(headings), f"|{alignment}", *map(_line, lines)])


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cell.replace('|', _BAR) for cell in cells)} |"
