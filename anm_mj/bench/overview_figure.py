"""Figure of a comparison over all its scenes: mean curves with intervals, and performance profiles.

A performance profile (Dolan and More, "Benchmarking optimization software with performance profiles", Mathematical
Programming 91, 2002) shows for every factor in how many runs a policy needs at most so many times the fewest steps that
any run needs from the same start. A run that never gets there counts in none.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from anm_mj.bench.best_known import situation
from anm_mj.bench.line_styles import legend_name, style
from anm_mj.bench.run_result import OBSERVABLE, Result, compared, drawn_variants
from anm_mj.bench.statistics import LEAST_SCENES, bootstrap_interval
from anm_mj.viz.figure_file import PICTURE, fit_ratio, plain, save_figure

LEVEL = 90.0
"""Level of the observable ratio that the profile counts steps to [%]."""
LARGEST_FACTOR = 5.0
SHARES = np.linspace(0.0, 1.0, 101)
"""Shares of the budget at which curves are averaged over scenes."""


def draw_overview(path: Path, results: Sequence[Result], kinds: Sequence[str] = (PICTURE,)) -> list[Path]:
    """Draw curves and profiles of the variants that ran from about all starts of all scenes, at one budget. The ending
    of ``path`` is replaced by each of ``kinds`` (``png``, ``pdf``, ``svg``). Returns the files. Raises OSError if a
    file cannot be written.
    """
    figure = Figure(figsize=(11.0, 4.4), dpi=120, layout="constrained")
    left, right = figure.subplots(1, 2)
    fewest = _fewest(results)
    variants, count = drawn_variants(results)
    with_band = compared(variants)
    for k, (name, runs) in enumerate(variants.items()):
        _draw_curve(left, runs, k, name, with_band=name in with_band)
        factors = np.sort([max(run.steps_to(LEVEL), 1.0) / fewest[situation(run)] for run in runs])
        factors = factors[np.isfinite(factors)]
        at = np.concatenate([[1.0], factors, [LARGEST_FACTOR]])
        share = np.concatenate([np.arange(len(factors) + 1), [len(factors)]]) / len(runs)
        right.step(at, 100.0 * share, where="post", lw=1.5, markevery=0.2, ms=5, mec="white", mew=0.6, **style(k))
    scenes = len({run.job.scene_name for runs in variants.values() for run in runs})
    left_out = f"; left out for having fewer runs: {count}" if count else ""
    whose = f" of {' and '.join(with_band)}" if len(variants) > len(with_band) else ""
    band = (
        f"band{whose}: 95 % of a bootstrap over scenes" if scenes >= LEAST_SCENES else "too few scenes for an interval"
    )
    left.set(xlabel="share of the budget [%]", ylabel="observable ratio [%]", xlim=(0, 100))
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
        steps = result.steps_to(LEVEL)
        fewest[situation(result)] = min(fewest.get(situation(result), np.inf), steps if np.isfinite(steps) else np.inf)
    # A level that the first view reaches takes no steps.
    return {key: max(steps, 1.0) for key, steps in fewest.items()}


def _draw_curve(axes: Axes, runs: Sequence[Result], k: int, name: str, *, with_band: bool) -> None:
    """Mean over scenes of each scene's mean curve, with its interval."""
    per_scene: dict[str, list[Float[np.ndarray, " shares"]]] = {}
    for run in runs:
        values = np.interp(SHARES * run.budget, run.curve[:, 0], run.curve[:, OBSERVABLE])
        per_scene.setdefault(run.job.scene_name, []).append(values)
    means = np.array([np.mean(curves, axis=0) for curves in per_scene.values()])
    axes.plot(100.0 * SHARES, means.mean(axis=0), lw=1.5, markevery=(5 * k % 20, 20), ms=5, mec="white", mew=0.6,
              label=legend_name(name), **style(k))  # fmt: skip
    if with_band and len(means) >= LEAST_SCENES:
        low, high = np.array([bootstrap_interval(column) for column in means.T]).T
        axes.fill_between(100.0 * SHARES, low, high, color=style(k)["color"], alpha=0.12, lw=0.0)
