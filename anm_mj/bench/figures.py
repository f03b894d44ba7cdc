"""Figures of a comparison, readable without colour: every variant has a line style and a mark of its own.

A performance profile (Dolan and More, "Benchmarking optimization software with performance profiles", Mathematical
Programming 91, 2002) shows for every factor in how many runs a policy needs at most so many times the fewest steps that
any run needs from the same start. A run that never gets there counts in none.
"""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from anm_mj.bench.results_table import situation
from anm_mj.bench.run_result import COMPLETION, OBSERVABLE, Result, compared, drawn_variants
from anm_mj.bench.statistics import LEAST_SCENES, bootstrap_interval, grouped
from anm_mj.scene.folder import Scene
from anm_mj.scene.navigable import scene_area
from anm_mj.types import DEFAULT_FOOTPRINT
from anm_mj.viz.figure_file import PICTURE, fit_ratio, plain, save_figure

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#7a3fa0", "#000000", "#b8860b", "#7b3f00", "#cc79a7", "#7f7f7f")
"""Apart for colour-blind eyes, after Okabe and Ito, Color Universal Design, 2008; one blue alone."""
LINES: tuple[Any, ...] = ("-", "--", "-.", (0, (1, 1)), (0, (5, 1, 1, 1, 1, 1)))
MARKS = ("o", "s", "^", "D", "v", "P", "X", "<", "*", "h", ">")
"""The lengths of the three have no common divisor, so that hundreds of variants differ."""
LINE_CHARACTERS, MOST_LINES = 34, 4
"""Of a name in a legend."""
CURVE_POINTS = 201
MARKS_PER_CURVE = 7
LEVEL = 90.0
"""Level of the observable ratio that the profile counts steps to [%]."""
LARGEST_FACTOR = 5.0
SHARES = np.linspace(0.0, 1.0, 101)
"""Shares of the budget at which curves are averaged over scenes."""
WALL, UNREACHED, FLOOR = 0.25, 0.85, 1.0
"""Shades of grey: obstacles, floor that the robot does not reach, and floor that it does."""


def style(k: int) -> dict[str, Any]:
    """Colour, line and mark of the variant of this number, as matplotlib takes them."""
    return {"color": COLOURS[k % len(COLOURS)], "ls": LINES[k % len(LINES)], "marker": MARKS[k % len(MARKS)]}


def legend_name(name: str) -> str:
    """A variant's name for a legend, in lines that leave room for the curves and no more than a few of them."""
    lines = textwrap.wrap(name, LINE_CHARACTERS, max_lines=MOST_LINES, placeholder=" ...")
    return plain("\n".join(lines))


def _shown(results: Sequence[Result]) -> int:
    """The column of the curves to show: the ratio of the observable surface, where all runs know it."""
    known = all(np.isfinite(result.curve[:, OBSERVABLE]).all() for result in results)
    return OBSERVABLE if known else COMPLETION


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
    column = _shown(results)
    label = "completion ratio, observable [%]" if column == OBSERVABLE else "completion ratio [%]"
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
    counts = [len(runs) for runs in variants.values()]
    title = [scene + (f", budget by {by}" if by else ""), _lines_and_bands(counts, with_band)]
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
    return f"mean of {runs}, {_band(len(counts), with_band)}: one standard deviation"


def _band(num_variants: int, with_band: Sequence[str]) -> str:
    """Whose band is drawn."""
    return f"band of {' and '.join(with_band)}" if num_variants > len(with_band) else "band"


def draw_overview(path: Path, results: Sequence[Result], kinds: Sequence[str] = (PICTURE,)) -> list[Path]:
    """Draw curves and profiles of the variants that ran from about all starts of all scenes, at one budget. Arguments
    and result as of :func:`draw_curves`. Raises OSError if a file cannot be written.
    """
    figure = Figure(figsize=(11.0, 4.4), dpi=120, layout="constrained")
    left, right = figure.subplots(1, 2)
    fewest = _fewest(results)
    variants, count = drawn_variants(results)
    column = _shown([run for runs in variants.values() for run in runs])
    with_band = compared(variants)
    for k, (name, runs) in enumerate(variants.items()):
        _draw_curve(left, runs, column, k, name, with_band=name in with_band)
        factors = np.sort([max(run.steps_to(LEVEL), 1.0) / fewest[situation(run)] for run in runs])
        factors = factors[np.isfinite(factors)]
        at = np.concatenate([[1.0], factors, [LARGEST_FACTOR]])
        share = np.concatenate([np.arange(len(factors) + 1), [len(factors)]]) / len(runs)
        right.step(at, 100.0 * share, where="post", lw=1.5, markevery=0.2, ms=5, mec="white", mew=0.6, **style(k))
    scenes = len({run.job.scene_name for runs in variants.values() for run in runs})
    left_out = f"; left out for having fewer runs: {count}" if count else ""
    band = f"{_band(len(variants), with_band)}: 95 % of a bootstrap over scenes"
    band = band if scenes >= LEAST_SCENES else "too few scenes for an interval"
    ratio = "observable" if column == OBSERVABLE else "completion"
    left.set(xlabel="share of the budget [%]", ylabel=f"{ratio} ratio [%]", xlim=(0, 100))
    fit_ratio(left)
    left.set_title(f"mean over {scenes} scene{'s' * (scenes > 1)}{left_out}\n{plain(band)}", fontsize=9)
    right.set(xlabel="steps / fewest steps from the same start", ylabel="runs [%]")
    fit_ratio(right)
    right.set_ylim(top=1.02 * right.get_ylim()[1])
    right.set(xlim=(1.0, LARGEST_FACTOR))
    right.set_title(f"performance profile: runs that reach {LEVEL:.0f} % within so many times the fewest", fontsize=9)
    if not np.isfinite(list(fewest.values())).any():
        right.text(0.5, 0.5, f"no run reaches {LEVEL:.0f} %", transform=right.transAxes, ha="center", color="dimgray")
    for axes in (left, right):
        axes.grid(alpha=0.3)
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    return save_figure(figure, path, kinds)


def _fewest(results: Sequence[Result]) -> dict[tuple[object, ...], float]:
    """Fewest steps of any run to the level in each situation; infinite where none gets there."""
    fewest: dict[tuple[object, ...], float] = {}
    for result in results:
        steps, key = result.steps_to(LEVEL), situation(result)
        # A level that the first view reaches takes no steps.
        fewest[key] = min(fewest.get(key, np.inf), max(steps, 1.0) if np.isfinite(steps) else np.inf)
    return fewest


def _draw_curve(axes: Axes, runs: Sequence[Result], column: int, k: int, name: str, *, with_band: bool) -> None:
    """Mean over scenes of each scene's mean of a column of the curves, with its interval."""
    per_scene = grouped(
        (run.job.scene_name, np.interp(SHARES * run.budget, run.curve[:, 0], run.curve[:, column])) for run in runs
    )
    means = np.array([np.mean(curves, axis=0) for curves in per_scene.values()])
    axes.plot(100.0 * SHARES, means.mean(axis=0), lw=1.5, markevery=(5 * k % 20, 20), ms=5, mec="white", mew=0.6,
              label=legend_name(name), **style(k))  # fmt: skip
    if with_band and len(means) >= LEAST_SCENES:
        low, high = np.array([bootstrap_interval(values) for values in means.T]).T
        axes.fill_between(100.0 * SHARES, low, high, color=style(k)["color"], alpha=0.12, lw=0.0)


def median_run(runs: Sequence[Result]) -> Result:
    """The run whose area under the curve is the median; of an even number the worse of the two in the middle."""
    column = _shown(runs)
    ordered = sorted(runs, key=lambda run: (run.area_under_curve(column), run.job.start, run.job.seed))
    return ordered[(len(ordered) - 1) // 2]


def draw_scene(path: Path, scene: Scene, results: Sequence[Result]) -> list[Path]:
    """Draw the plan of a scene with the trajectory of the median run of each variant that ran from all starts. Returns
    the files. Raises OSError if a file cannot be written, RunFolderError if the log of a run is damaged.
    """
    variants, left_out = drawn_variants(results)
    area = scene_area(scene, DEFAULT_FOOTPRINT)
    shade = np.where(area.component == 1, FLOOR, np.where(area.clearance_m > 0.0, UNREACHED, WALL))
    low = area.grid.origin_xy_m
    high = low + np.array(shade.shape[::-1]) * area.grid.resolution_m
    width, height = high - low
    figure = Figure(figsize=(7.0, min(7.0 * height / width, 9.0) + 1.0), dpi=110, layout="constrained")
    axes = figure.add_subplot()
    axes.imshow(
        shade, origin="lower", extent=(low[0], high[0], low[1], high[1]), cmap="gray", vmin=0.0, vmax=1.0,
        interpolation="nearest",
    )  # fmt: skip
    for k, (name, runs) in enumerate(variants.items()):
        xy_m = median_run(runs).trajectory_xy_m()
        axes.plot(
            *xy_m.T, lw=1.3, markevery=0.25, ms=4, mec="white", mew=0.5, label=legend_name(name), alpha=0.9, **style(k)
        )
        axes.plot(*xy_m[0], "o", ms=6, mfc="white", mec=style(k)["color"], zorder=4)
    axes.set(xlabel="x [m]", ylabel="y [m]")
    fewer = f"\nleft out for having fewer runs: {left_out}" if left_out else ""
    axes.set_title(f"{plain(scene.name)}: the run of median AUC of each policy (ring: its start){fewer}", fontsize=9)
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=8)
    return save_figure(figure, path, (PICTURE,))
