"""How well the frames of a recorded sequence fit their map, as a picture."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from anm_mj.viz.figure_file import PICTURE, save_figure


def draw_fit(
    path: Path, fitting: Sequence[float | None], residual_m: Sequence[float | None], misfits: Sequence[int]
) -> None:
    """Draw share of fitting points and residual over the frames. ``fitting`` is the share of the known points that the
    map confirms, None where it knows too little, ``residual_m`` their median distance from the surface; ``misfits`` are
    frames that do not fit.
    """
    figure = Figure(figsize=(7.0, 3.6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for axes, values, factor, label in (
        (upper, fitting, 100.0, "fitting points [%]"),
        (lower, residual_m, 100.0, "residual [cm]"),
    ):
        known = [at for at, value in enumerate(values) if value is not None]
        axes.plot(
            known,
            [factor * value for at, value in enumerate(values) if value is not None],
            ".-",
            markersize=3,
            linewidth=0.8,
        )
        axes.set_ylabel(label)
        axes.set_ylim(bottom=0.0)
        for at in misfits:
            axes.axvline(at, color="#c44e52", alpha=0.4, linewidth=1.0)
    lower.set_xlabel("frame")
    save_figure(figure, path, (PICTURE,))
