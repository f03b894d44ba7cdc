"""Draws a robot from three sides as one PNG, with its measures and a legend."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from anm_mj.io.write import writing
from anm_mj.viz.figure_file import PICTURE, plain, write_figure

if TYPE_CHECKING:
    from anm_mj.robot.description import RobotDescription

SIDES = ("from the front", "from its left", "from above")
FOOTPRINT, CAMERA, MEASURE = "#d9261a", "#1a59e6", "#1f1f1f"


def save_robot_sheet(
    path: Path, images: Sequence[UInt8[np.ndarray, "_ _ 3"]], width_m: float, robot: RobotDescription
) -> None:
    """Write the picture. The ``images`` of :func:`anm_mj.sim.robot_views.robot_views` show ``width_m`` from side to
    side and from top to bottom. Raises RunFolderError if the file cannot be written.
    """
    figure = Figure(figsize=(11.4, 4.6), dpi=110, layout="constrained")
    half, camera_m = width_m / 2.0, robot.T_base_camera[2, 3]
    radius, top = robot.footprint.radius_m, robot.footprint.z_max_m
    middle = max(top, camera_m) / 2.0
    front, left, above = np.ravel(figure.subplots(1, 3))
    for axes, image, title, centre in zip((front, left, above), images, SIDES, (middle, middle, 0.0), strict=True):
        axes.imshow(image, extent=(-half, half, centre - half, centre + half))
        axes.set_title(title, fontsize=10)
        axes.set_xlabel("m", fontsize=8)
        axes.tick_params(labelsize=7)
    # From the left, x points to the left.
    left.set_xticks(front.get_xticks(), [f"{0.0 - tick:.3g}" for tick in front.get_xticks()])
    left.set_xlim(-half, half)
    aside = min(radius + 0.06 * width_m, 0.8 * half)
    _measure(front, (-aside, 0.0), (-aside, top), f"{top:.2f} m")
    _measure(left, (aside, 0.0), (aside, camera_m), f"camera {camera_m:.2f} m")
    _measure(above, (-radius, -aside), (radius, -aside), f"{2.0 * radius:.2f} m")
    if robot.track_m:
        below = middle - 0.94 * half
        measures = f"track {robot.track_m:.2f} m, wheels {2.0 * robot.wheel_radius_m:.2f} m"
        _measure(front, (-robot.track_m / 2.0, below), (robot.track_m / 2.0, below), measures)
    handles = [
        Patch(color=FOOTPRINT, alpha=0.8, label="footprint, what is kept free of obstacles"),
        Line2D([], [], color=CAMERA, linewidth=3, label="where the camera looks"),
    ]
    figure.suptitle(plain(f"{robot.name}: {robot.kind}, {robot.mass_kg:.1f} kg"), fontsize=11)
    figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    with writing(path):
        write_figure(figure, path, PICTURE)


def _measure(axes: Axes, begin: tuple[float, float], end: tuple[float, float], text: str) -> None:
    """A line between two points with its length beside it."""
    axes.annotate("", begin, end, arrowprops={"arrowstyle": "<|-|>", "color": MEASURE, "shrinkA": 0, "shrinkB": 0})
    upright = begin[0] == end[0]
    middle = ((begin[0] + end[0]) / 2.0, (begin[1] + end[1]) / 2.0)
    axes.annotate(
        text,
        middle,
        (-4, 0) if upright else (0, 3),
        textcoords="offset points",
        ha="right" if upright else "center",
        va="center" if upright else "bottom",
        rotation=90 if upright else 0,
        fontsize=8,
    )
