"""The contact sheet of a checked scene: a view from above, rooms and doors, and six views from inside."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from anm_mj.errors import SceneError
from anm_mj.scene.check import SceneCheck


def write_sheet(
    check: SceneCheck,
    above: UInt8[np.ndarray, "h w 3"],
    views: list[UInt8[np.ndarray, "_ _ 3"]],
    out: Path,
) -> None:
    """Write a PNG.

    Args:
        check: the findings.
        above: the scene from above, x to the right, y up.
        views: from inside; the first six are shown.
        out: the file.

    Raises:
        SceneError: if the file cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(15, 12), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(check.scene.name)
    grid = figure.add_gridspec(4, 6, height_ratios=(1.2, 1.2, 1.0, 1.0))
    left, right = figure.add_subplot(grid[:2, :3]), figure.add_subplot(grid[:2, 3:])
    left.imshow(above)
    left.set_title("from above, cut at 2 m")
    left.set_axis_off()
    _draw_plan(right, check)
    for i, view in enumerate(views[:6]):
        axes = figure.add_subplot(grid[2 + i // 3, 2 * (i % 3) : 2 * (i % 3) + 2])
        axes.set_axis_off()
        axes.imshow(view)
        axes.set_title(f"view {i + 1}", fontsize=9)
    try:
        figure.savefig(out, dpi=80, format="png")
    except OSError as err:
        raise SceneError(f"{out} cannot be written ({err.strerror}): choose another place with --out.") from err


def _draw_plan(axes, check: SceneCheck) -> None:
    """Rooms in colour, saturated where the robot can stand; doors with their widths; starts."""
    axes.set_title("rooms and doors (pale: the robot cannot stand there)")
    axes.set_aspect("equal")
    if check.area is None or check.plan is None:
        axes.text(0.5, 0.5, "nowhere to stand", ha="center", transform=axes.transAxes)
        return
    grid, room = check.area.grid, check.plan.room
    hues = np.array([[78, 121, 167], [242, 142, 43], [89, 161, 79], [225, 87, 89], [118, 183, 178], [237, 201, 72],
                     [176, 122, 161], [156, 117, 95], [255, 157, 167]]) / 255.0  # fmt: skip
    picture = np.ones((*room.shape, 3))
    inside = room > 0
    picture[inside] = 0.35 * hues[(room[inside] - 1) % len(hues)] + 0.65
    stand = check.area.component > 0
    picture[stand] = np.where((room[stand] > 0)[:, None], hues[(room[stand] - 1) % len(hues)], 0.5)
    x, y = grid.origin_xy_m
    extent = (x, x + grid.cols * grid.resolution_m, y, y + grid.rows * grid.resolution_m)
    axes.imshow(picture, origin="lower", extent=extent, interpolation="nearest")
    for number, size_m2 in enumerate(check.plan.area_m2, start=1):
        rows, cols = np.nonzero(room == number)
        # The cell in the middle of the list lies within the room, which the mean of a corridor may not.
        middle = np.argmin((rows - rows.mean()) ** 2 + (cols - cols.mean()) ** 2)
        axes.text(
            *grid.centres_m(rows[middle], cols[middle]),
            f"{number}\n{size_m2:.1f} m²",
            ha="center",
            va="center",
            fontsize=7,
        )
    for door in check.plan.doors:
        axes.plot(*door.xy_m, "o", color="black" if door.fits else "red", markersize=4)
        axes.annotate(f"{door.width_m:.2f}", door.xy_m, fontsize=6, xytext=(3, 3), textcoords="offset points")
    for start in check.scene.starts:
        arrow = (0.4 * np.cos(start.yaw_rad), 0.4 * np.sin(start.yaw_rad))
        axes.arrow(start.x_m, start.y_m, *arrow, width=0.05, color="black")
    for hole_x, hole_y, _ in check.holes:
        axes.plot(hole_x, hole_y, "rx")
