"""The contact sheet of a checked scene: a view from above beside rooms and doors, and six views from inside."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int, UInt8
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from PIL.ImageColor import getrgb
from scipy.spatial import KDTree

from anm_mj.errors import SceneError
from anm_mj.types import Pose2
from anm_mj.viz.figure_file import plain, write_figure

if TYPE_CHECKING:
    from anm_mj.scene.check import SceneCheck

VIEWS = 6
MARGIN_M = 0.3
HUES = np.array([[78, 121, 167], [242, 142, 43], [89, 161, 79], [225, 87, 89], [118, 183, 178], [237, 201, 72],
                 [176, 122, 161], [156, 117, 95], [255, 157, 167]]) / 255.0  # fmt: skip
PALE = 0.65
"""How far the colour of a room goes towards white where the robot cannot stand."""
CUT_OFF = "#808080"
GROUND = "#eef0f3"
"""Where nothing is, as in the view from above."""
DOOR, NARROW, VIEW = "#111111", "#c8323c", "#c8323c"
ARROW_SHARE, LABEL_SHARE = 0.06, 0.09
"""Length of a view's arrow, and what the label of a room keeps clear of its number, in the longer side of the scene."""


def write_sheet(
    check: SceneCheck,
    above: UInt8[np.ndarray, "h w 3"],
    above_m: Float[np.ndarray, "2 2"],
    cut_m: float,
    views: Sequence[UInt8[np.ndarray, "_ _ 3"]],
    poses: Sequence[Pose2],
    out: Path,
) -> None:
    """Write a PNG, a PDF or an SVG, as the file's ending says. ``above`` is the scene from above, x to the right, y up,
    between the corners ``above_m``, cut at ``cut_m``; of the ``views`` from inside, taken at ``poses``, the first six
    are shown. Raises SceneError if the file cannot be written.
    """
    low, high = check.scene.bounds_m[:, :2]
    width_m, depth_m = high - low + 2.0 * MARGIN_M
    # Two maps and a row of six square views, in a sheet without empty corners.
    map_in = float(np.clip(7.0 * depth_m / width_m, 3.0, 9.0))
    figure = Figure(figsize=(15.0, map_in + 4.2), dpi=100, layout="constrained")
    figure.suptitle(plain(_title(check)), fontsize=13)
    grid = figure.add_gridspec(2, VIEWS, height_ratios=(map_in + 0.6, 2.6))
    left = figure.add_subplot(grid[0, :3])
    right = figure.add_subplot(grid[0, 3:], sharex=left, sharey=left)
    left.imshow(above, extent=(above_m[0, 0], above_m[1, 0], above_m[0, 1], above_m[1, 1]))
    # Walls of solid models are hollow, and look like floor from above.
    lines_m = list(cut_lines(*check.scene.triangles(), cut_m))
    left.add_collection(LineCollection(lines_m, colors=DOOR, lw=0.8, rasterized=True))
    left.set_title(f"from above, cut at {cut_m:g} m", fontsize=10)
    side_m = float(max(width_m, depth_m))
    tips_m = [
        ARROW_SHARE * side_m * np.array([np.cos(pose.yaw_rad), np.sin(pose.yaw_rad)]) + pose.xy_m for pose in poses
    ]
    taken_m = np.array([*tips_m, *(pose.xy_m for pose in poses)]).reshape(-1, 2)
    _draw_plan(right, check, taken_m, LABEL_SHARE * side_m)
    shown = list(zip(views, poses, tips_m, strict=True))[:VIEWS]
    for i, (view, pose, tip_m) in enumerate(shown, start=1):
        for axes in (left, right):
            _mark_view(axes, i, pose, tip_m)
        axes = figure.add_subplot(grid[1, i - 1])
        axes.set_axis_off()
        axes.imshow(view)
        axes.set_title(f"view {i}", fontsize=9)
    for axes in (left, right):
        axes.set(xlim=(low[0] - MARGIN_M, high[0] + MARGIN_M), ylim=(low[1] - MARGIN_M, high[1] + MARGIN_M))
        axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", facecolor=GROUND)
    figure.legend(handles=_legend(cut_m), loc="outside lower center", ncols=5, fontsize=9, frameon=False)
    try:
        write_figure(figure, out, out.suffix[1:])
    except OSError as err:
        raise SceneError(f"{out} cannot be written ({err.strerror}): choose another place with --out.") from err


def cut_lines(
    vertices_m: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], height_m: float
) -> Float[np.ndarray, "s 2 2"]:
    """Where triangles cross a height: the x, y of both ends of a segment per triangle [m]."""
    above = vertices_m[:, 2] > height_m
    count = above[faces].sum(axis=1)
    crossing = faces[(count == 1) | (count == 2)]
    # The vertex that is alone on its side first; both segments that leave it cross.
    alone = np.argmax(above[crossing] == (above[crossing].sum(axis=1) == 1)[:, None], axis=1)
    corners = vertices_m[crossing[np.arange(len(crossing))[:, None], (alone[:, None] + np.arange(3)) % 3]].astype(float)
    start, ends = corners[:, :1], corners[:, 1:]
    share = (height_m - start[..., 2:]) / (ends[..., 2:] - start[..., 2:])
    return (start + share * (ends - start))[..., :2]


def _title(check: SceneCheck) -> str:
    if check.area is None or check.plan is None:
        return f"{check.scene.name}: the robot can stand nowhere"
    count = len(check.plan.area_m2)
    rooms = "1 room" if count == 1 else f"{count} rooms"
    return f"{check.scene.name}: {rooms}, {check.area.area_m2:.1f} m² that the robot reaches"


def _draw_plan(axes: Axes, check: SceneCheck, taken_m: Float[np.ndarray, "k 2"], apart_m: float) -> None:
    """Rooms in colour, pale where the robot cannot stand; doors with their widths; starts and holes. No label of a room
    should stand nearer than ``apart_m`` to ``taken_m``.
    """
    axes.set_title("rooms with their area, doors with their width [m]", fontsize=10)
    if check.area is None or check.plan is None:
        return
    grid, room = check.area.grid, check.plan.room
    picture = np.full((*room.shape, 3), np.array(getrgb(GROUND)) / 255.0)
    inside = room > 0
    picture[inside] = (1.0 - PALE) * HUES[(room[inside] - 1) % len(HUES)] + PALE
    stand = check.area.component > 0
    cut_off = np.array(getrgb(CUT_OFF)) / 255.0
    picture[stand] = np.where((room[stand] > 0)[:, None], HUES[(room[stand] - 1) % len(HUES)], cut_off)
    x, y = grid.origin_xy_m
    extent = (x, x + grid.cols * grid.resolution_m, y, y + grid.rows * grid.resolution_m)
    axes.imshow(picture, origin="lower", extent=extent, interpolation="nearest")
    for number, size_m2 in enumerate(check.plan.area_m2, start=1):
        rows, cols = np.nonzero(room == number)
        place = _label_place(grid.centres_m(rows, cols), taken_m, apart_m)
        box = {"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.75}
        axes.text(
            place[0], place[1], f"room {number}\n{size_m2:.1f} m²", ha="center", va="center", fontsize=8, bbox=box
        )
    for door in check.plan.doors:
        colour, mark = (DOOR, "o") if door.fits else (NARROW, "X")
        axes.plot(*door.xy_m, mark, color=colour, ms=6, mec="white", mew=0.6)
        x, y = door.xy_m.tolist()
        axes.annotate(f"{door.width_m:.2f}", (x, y), fontsize=8, xytext=(5, 4), textcoords="offset points")
    for start in check.scene.starts:
        axes.plot(start.x_m, start.y_m, "D", color=DOOR, ms=5, mec="white", mew=0.6)
    for hole_x, hole_y, _ in check.holes:
        axes.plot(hole_x, hole_y, "x", color=NARROW, ms=7)


def _label_place(
    cells_m: Float[np.ndarray, "n 2"], taken_m: Float[np.ndarray, "k 2"], apart_m: float
) -> Float[np.ndarray, "2"]:
    """The cell of a room nearest to its middle, which may lie outside of a corridor, and clear of what is there."""
    from_middle = np.linalg.norm(cells_m - cells_m.mean(axis=0), axis=1)
    if len(taken_m):
        from_taken = KDTree(taken_m).query(cells_m, distance_upper_bound=apart_m)[0]
        from_middle += 2.0 * (apart_m - np.minimum(from_taken, apart_m))
    return cells_m[np.argmin(from_middle)]


def _mark_view(axes: Axes, number: int, pose: Pose2, tip_m: Float[np.ndarray, "2"]) -> None:
    """A number at the tip of an arrow in the direction of the view."""
    x, y = tip_m.tolist()
    arrow = {"arrowstyle": "-|>", "color": VIEW, "lw": 1.6, "shrinkA": 0.0, "shrinkB": 8.0}
    axes.annotate("", (x, y), (pose.x_m, pose.y_m), arrowprops=arrow)
    box = {"boxstyle": "circle,pad=0.15", "fc": "white", "ec": VIEW, "lw": 1.0}
    axes.text(x, y, str(number), ha="center", va="center", fontsize=8, color=VIEW, weight="bold", bbox=box)


def _legend(cut_m: float) -> list[Line2D | Patch]:
    def mark(shape: str, colour: str, words: str) -> Line2D:
        return Line2D([], [], ls="", marker=shape, color=colour, label=words)

    full, pale = HUES[0], (1.0 - PALE) * HUES[0] + PALE
    return [
        Patch(fc=full, label="room: the robot can stand"),
        Patch(fc=pale, label="room: it cannot stand"),
        Patch(fc=CUT_OFF, label="cut off from the rooms"),
        Line2D([], [], color=DOOR, lw=0.8, label=f"walls at {cut_m:g} m"),
        mark("o", DOOR, "door"),
        mark("X", NARROW, "door too narrow"),
        mark("D", DOOR, "start"),
        mark("x", NARROW, "hole in the floor"),
        mark("$1$", VIEW, "view, with its direction"),
    ]
