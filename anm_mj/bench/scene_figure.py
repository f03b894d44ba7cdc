"""Picture of a scene of a comparison: its plan with the median trajectory of each variant."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from anm_mj.bench.line_styles import legend_name, style
from anm_mj.bench.run_result import OBSERVABLE, Result, drawn_variants
from anm_mj.scene.folder import Scene
from anm_mj.scene.navigable import scene_area
from anm_mj.types import DEFAULT_FOOTPRINT
from anm_mj.viz.figure_file import PICTURE, plain, save_figure

WALL, UNREACHED, FLOOR = 0.25, 0.85, 1.0
"""Shades of grey: obstacles, floor that the robot does not reach, and floor that it does."""


def median_run(runs: Sequence[Result]) -> Result:
    """The run whose area under the curve is the median; of an even number the worse of the two in the middle."""
    ordered = sorted(runs, key=lambda run: (run.area_under_curve(OBSERVABLE), run.job.start, run.job.seed))
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
