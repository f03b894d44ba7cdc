"""Writes a figure as PNG, PDF or SVG: the same figure gives the same bytes, and a journal can take it."""

import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from anm_mj.utils.files import atomic_write

PICTURE, PRINT, VECTOR = "png", "pdf", "svg"
KINDS = (PICTURE, PRINT, VECTOR)
STYLE: dict[Any, Any] = {
    # Publishers refuse the default, Type 3; 42 embeds TrueType.
    "pdf.fonttype": 42,
    # Names in an SVG are drawn at random without it.
    "svg.hashsalt": "anm-mj",
}
METADATA: dict[str, dict[str, Any] | None] = {PICTURE: None, PRINT: {"CreationDate": None}, VECTOR: {"Date": None}}
"""Without dates."""


class ShownFigure(Figure):
    """A figure that notebooks show, without a window system."""

    def _repr_png_(self) -> bytes:
        written = io.BytesIO()
        FigureCanvasAgg(self).print_figure(written, format=PICTURE, bbox_inches="tight", pad_inches=0.1)
        return written.getvalue()


def plain(text: str) -> str:
    """A text for a figure that is drawn as it stands: names hold anything, and matplotlib takes $ for a formula."""
    return text.replace("$", r"\$")


def fit_ratio(axes: Axes) -> None:
    """Let the y axis of ratios [%] end with the ten above the highest curve."""
    drawn = [np.asarray(line.get_ydata(), float) for line in axes.get_lines()]
    highest = max((float(np.nanmax(values)) for values in drawn if np.isfinite(values).any()), default=100.0)
    axes.set_ylim(0.0, min(100.0, 10.0 * math.ceil((highest + 1.0) / 10.0)))


def save_figure(figure: Figure, path: Path, kinds: Sequence[str] = (PICTURE,)) -> list[Path]:
    """Write a figure once per kind, beside each other, each file whole or not at all. Its resolution counts for the
    PNG; the ending of ``path`` is replaced by the kind, ``png``, ``pdf`` or ``svg``. Returns the files. Raises OSError
    if a file cannot be written.
    """
    paths = [path.with_suffix(f".{kind}") for kind in kinds]
    for kind, file in zip(kinds, paths, strict=True):
        write_figure(figure, file, kind)
    return paths


def write_figure(figure: Figure, path: Path, kind: str) -> None:
    """Write a figure as one kind, whatever the file's ending. Raises OSError if the file cannot be written."""
    with atomic_write(path) as partial, matplotlib.rc_context(STYLE):
        FigureCanvasAgg(figure).print_figure(
            partial, format=kind, bbox_inches="tight", pad_inches=0.1, metadata=METADATA[kind]
        )
