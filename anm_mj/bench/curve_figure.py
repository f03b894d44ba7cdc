"""Completion curves of a comparison, readable without colour: every variant has a line style and a mark of its own."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from anm_mj.bench.line_styles import legend_name, style
from anm_mj.bench.run_result import COMPLETION, OBSERVABLE, Result, compared, drawn_variants
from anm_mj.viz.figure_file import PICTURE, fit_ratio, plain, save_figure

CURVE_POINTS = 201
MARKS_PER_CURVE = 7


def draw_curves(path: Path, scene: str, results: Sequence[Result], kinds: Sequence[str] = (PICTURE,)) -> list[Path]:
    """Draw the completion ratio against steps: the mean over a variant's runs; of two, a band of one deviation.

    The ratio of the observable surface, where all runs know it. A run that ends early keeps its last value. Variants of
    fewer runs than others are left out. All ``results`` of the scene are at one budget; the ending of ``path`` is
    replaced by each of ``kinds`` (``png``, ``pdf``, ``svg``). Returns the files. Raises OSError if a file cannot be
    written.
    """
    variants, left_out = drawn_variants(results)
    results = [run for runs in variants.values() for run in runs]
    budget = max(result.job.steps for result in results)
    steps = np.linspace(0.0, budget, CURVE_POINTS)
    known = all(np.isfinite(result.curve[:, OBSERVABLE]).all() for result in results)
    column, label = (OBSERVABLE, "completion ratio, observable [%]") if known else (COMPLETION, "completion ratio [%]")
    figure = Figure(figsize=(9.5, 4.5), dpi=120, layout="constrained")
    axes = figure.add_subplot()
    with_band = compared(variants)
    for k, (name, runs) in enumerate(variants.items()):
        values = np.stack([np.interp(steps, run.curve[:, 0], run.curve[:, column]) for run in runs])
        mean = values.mean(axis=0)
        colour, line, mark = (style(k)[key] for key in ("color", "ls", "marker"))
        # The marks of one curve stand between those of the others.
        every = CURVE_POINTS // MARKS_PER_CURVE
        at = (round(every * (k + 0.5) / len(variants)), every)
        axes.plot(steps, mean, ls=line, lw=1.5, color=colour, marker=mark, markevery=at, ms=5.5, mec="white", mew=0.6,
                  label=legend_name(name), zorder=3)  # fmt: skip
        if len(runs) > 1 and name in with_band:
            deviation = values.std(axis=0, ddof=1)
            low, high = np.clip([mean - deviation, mean + deviation], 0.0, 100.0)
            axes.fill_between(steps, low, high, color=colour, alpha=0.12, lw=0.0)
            # Where bands overlap, only their edges tell them apart.
            axes.plot(steps, np.stack([low, high], axis=1), ls=line, lw=0.6, color=colour, alpha=0.6)
    axes.set(xlabel="step", ylabel=label, xlim=(0.0, budget))
    fit_ratio(axes)
    by = results[0].budget_by
    title = [
        scene + (f", budget by {by}" if by else ""),
        _lines_and_bands([len(runs) for runs in variants.values()], with_band),
    ]
    if left_out:
        title.append(f"left out for having fewer runs: {left_out}")
    axes.set_title(plain("\n".join(title)), fontsize=9)
    axes.grid(alpha=0.3)
    # Beside the curves: ten names with settings would hide half of the picture.
    figure.legend(loc="outside right upper", frameon=False, handlelength=3.5)
    return save_figure(figure, path, kinds)


def _lines_and_bands(counts: Sequence[int], with_band: Sequence[str]) -> str:
    """What lines and bands show, given the number of runs of each variant."""
    low, high = min(counts), max(counts)
    if high == 1:
        return "one run each"
    runs = f"{high} runs" if low == high else f"{low} to {high} runs"
    whose = f" of {' and '.join(with_band)}" if len(counts) > len(with_band) else ""
    return f"mean of {runs}, band{whose}: one standard deviation"
