"""Writes pictures side by side, each with a title, as one PNG."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from anm_mj.io.write import writing
from anm_mj.viz.figure_file import plain


def save_picture_row(path: Path, images: Sequence[UInt8[np.ndarray, "_ _ 3"]], titles: Sequence[str]) -> None:
    """Write the pictures from left to right.

    Raises:
        RunFolderError: the file cannot be written.
    """
    figure = Figure(figsize=(3.6 * len(images), 3.9), layout="constrained")
    for axes, image, title in zip(np.ravel(figure.subplots(1, len(images))), images, titles, strict=True):
        axes.imshow(image)
        axes.set_title(plain(title))
        axes.axis("off")
    with writing(path):
        FigureCanvasAgg(figure).print_figure(path, format="png", dpi=110)
