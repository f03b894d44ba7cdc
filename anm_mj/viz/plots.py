"""Figures of a run, rendered without a window system."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.legend_handler import HandlerBase
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Transform

from anm_mj.types import UNKNOWN, Plan, Pose2, Region, SurfaceChange, TopDownMap, VoronoiGraph
from anm_mj.viz import palette
from anm_mj.viz.figure_file import ShownFigure, fit_ratio, plain, save_figure

DOTS_PER_INCH = 150
ARROW = np.array([[1.0, 0.0], [-0.7, 0.6], [-0.35, 0.0], [-0.7, -0.6], [1.0, 0.0]])
"""Outline of the marker at the end of the trajectory, pointing along x."""
MARGIN_M = 0.4
"""Margin of unknown space around the known area [m]."""
JUNCTION_DEGREE = 3
"""Degree from which a vertex is a junction of the graph."""
SWATCH_PARTS = 12
"""Rectangles of the legend's gradient of free space."""
EDGE = "#8a8a8a"
STEP_COLOURS = LinearSegmentedColormap.from_list("steps", matplotlib.colormaps["plasma"](np.linspace(0.0, 0.8, 256)))
"""Dark to light with the steps; the bright yellow at plasma's end is lost on a bright floor and on paper."""


def topdown_figure(
    plan: Plan,
    poses: Sequence[Pose2 | None],
    *,
    target_xy_m: Float[np.ndarray, "2"] | None,
    title: str,
    changes: Sequence[SurfaceChange] = (),
) -> ShownFigure:
    """The top-down map of a plan that has one, with its Voronoi graph, its regions of interest and the trajectory.
    There is one pose per step, None where it was not known: the trajectory has a gap there. ``changes`` are surface
    that is gone or new since a prior run.
    """
    topdown, graph = plan.topdown, plan.graph
    assert topdown is not None
    (west, south), (east, north) = _known_corners(topdown)
    long_side = max(east - west, north - south)
    size = (max(6.0, 2.6 + 7.4 * (east - west) / long_side), 1.9 + 7.4 * (north - south) / long_side)
    figure = ShownFigure(figsize=size, dpi=DOTS_PER_INCH, layout="constrained")
    axes = figure.add_subplot()
    low, high = topdown.origin_xy_m, topdown.origin_xy_m + topdown.resolution_m * np.array(topdown.state.shape[::-1])
    axes.set_facecolor(palette.UNKNOWN)
    extent = (low[0], high[0], low[1], high[1])
    axes.imshow(palette.tint(topdown), origin="lower", extent=extent, interpolation="nearest")
    if graph is not None and len(graph.edges):
        ends = graph.vertex_xy_m[graph.edges]
        axes.add_collection(LineCollection(list(ends), colors=palette.GRAPH, linewidths=1.0, label="Voronoi graph"))
        junctions = graph.vertex_xy_m[graph.degree >= JUNCTION_DEGREE]
        axes.plot(*junctions.T, "o", ms=3.0, color=palette.GRAPH, label="junction", zorder=3)
    _draw_changes(axes, changes)
    _draw_regions(axes, plan.regions, graph)
    _draw_trajectory(figure, axes, poses)
    if target_xy_m is not None:
        axes.plot(*target_xy_m, "*", ms=14, color=palette.TARGET, mec="white", mew=0.8, label="last target", zorder=6)
    axes.set(xlabel="x [m]", ylabel="y [m]", xlim=(west, east), ylim=(south, north), aspect="equal")
    axes.set_title(plain(title), pad=10.0)
    drawn, names = axes.get_legend_handles_labels()
    free, space = Patch(), [("occupied", palette.WALL), ("unknown", palette.UNKNOWN)]
    if topdown.no_floor is not None and topdown.no_floor.any():
        space.insert(1, ("no floor", palette.NO_FLOOR))
    figure.legend(
        [free, *(Patch(fc=colour, ec=EDGE, lw=0.6) for _, colour in space), *drawn],
        [f"free, 0 to {palette.FULL_CLEARANCE_M:g} m clear", *(name for name, _ in space), *names],
        loc="outside lower center",
        ncols=4,
        fontsize=8,
        frameon=False,
        handler_map={free: _FreeSpaceSwatch()},
    )
    return figure


def curve_figure(
    curve: Mapping[str, Float[np.ndarray, " n"]], *, title: str, before_ratio: float | None = None
) -> ShownFigure:
    """Completion over steps, from the columns of ``curve.csv``, which may be empty: steps; fraction of the true surface
    within 5 cm of the observed points, and the same of the observable surface, NaN where that is not known [%]; mean
    distance of the true surface to the observed points, capped at 1 m [cm]. ``before_ratio`` is the completion ratio by
    the runs that this one goes on from [%], None if it began with nothing.
    """
    figure = ShownFigure(figsize=(7.0, 4.2), dpi=DOTS_PER_INCH, layout="constrained")
    ratio_axes = figure.add_subplot()
    cm_axes = ratio_axes.twinx()
    steps, observable_ratio = curve["step"], curve["observable_ratio"]
    lines: list[Artist] = []
    ratio: dict[str, Any] = {"color": palette.RATIO}
    if np.isfinite(observable_ratio).any():
        lines += ratio_axes.plot(steps, observable_ratio, lw=2.4, label="completion ratio, observable [%]", **ratio)
    label = "completion ratio (< 5 cm) [%]"
    lines += ratio_axes.plot(steps, curve["completion_ratio"], lw=1.4, ls="--", label=label, **ratio)
    if before_ratio is not None:
        label = f"covered before ({before_ratio:.1f} %)"
        lines.append(ratio_axes.axhspan(0.0, before_ratio, alpha=0.12, lw=0.0, label=label, **ratio))
    label = "completion [cm]"
    lines += cm_axes.plot(steps, curve["completion_cm"], color=palette.DISTANCE, lw=1.4, ls="-.", label=label)
    ratio_axes.set(title=plain(title), xlabel="step", xlim=(0, int(steps.max(initial=1))))
    fit_ratio(ratio_axes)
    ratio_axes.set_ylabel("completion ratio [%]", color=palette.RATIO)
    ratio_axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    ratio_axes.grid(alpha=0.3)
    cm_axes.set_ylabel("completion [cm]", color=palette.DISTANCE)
    cm_axes.set_ylim(bottom=0.0)
    figure.legend(handles=lines, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return figure


def draw_fit(
    path: Path,
    steps: Sequence[int],
    fitting: Sequence[float | None],
    residual_m: Sequence[float | None],
    misfits: Sequence[int],
) -> None:
    """Draw how well the frames of a recorded sequence fit their map. ``steps`` are their numbers in the sequence;
    ``fitting`` is the share of the known points that the map confirms, None where it knows too little, ``residual_m``
    their median distance from the surface; ``misfits`` are the indices of frames that do not fit.
    """
    figure = Figure(figsize=(7.0, 3.6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for axes, values, label in ((upper, fitting, "fitting points [%]"), (lower, residual_m, "residual [cm]")):
        known = [(step, 100.0 * value) for step, value in zip(steps, values, strict=True) if value is not None]
        axes.plot(*np.reshape(known, (-1, 2)).T, ".-", markersize=3, linewidth=0.8)
        axes.set_ylabel(label)
        axes.set_ylim(bottom=0.0)
        for at in misfits:
            axes.axvline(steps[at], color="#c44e52", alpha=0.4, linewidth=1.0)
    lower.set_xlabel("frame")
    save_figure(figure, path)


def _known_corners(topdown: TopDownMap) -> Float[np.ndarray, "2 2"]:
    """South-west and north-east corner of the known area with a margin, or of an unknown map as a whole [m]."""
    known = np.argwhere(topdown.state != UNKNOWN)
    if len(known) == 0:
        known = np.array([[0, 0], topdown.state.shape])
    col_row = np.stack([known.min(axis=0), known.max(axis=0) + 1])[:, ::-1]
    margin = np.array([[-MARGIN_M], [MARGIN_M]])
    return topdown.origin_xy_m + topdown.resolution_m * col_row + margin


class _FreeSpaceSwatch(HandlerBase):
    """Draws free space from beside an obstacle to clear."""

    def create_artists(
        self,
        legend: Legend,
        orig_handle: Any,
        xdescent: float,
        ydescent: float,
        width: float,
        height: float,
        fontsize: float,
        trans: Transform,
    ) -> list[Artist]:
        part = width / SWATCH_PARTS
        fills = palette.free_tint(np.linspace(0.0, 1.0, SWATCH_PARTS)) / 255.0
        drawn: list[Artist] = [
            # A hair wider, so that no seam shows between them in print.
            Rectangle((k * part - xdescent, -ydescent), part * 1.05, height, fc=fill, lw=0.0, transform=trans)
            for k, fill in enumerate(fills)
        ]
        drawn.append(Rectangle((-xdescent, -ydescent), width, height, fc="none", ec=EDGE, lw=0.6, transform=trans))
        return drawn


def _draw_changes(axes: Axes, changes: Sequence[SurfaceChange]) -> None:
    for kind, color, label in (
        ("gone", palette.GONE, "gone since the prior run"),
        ("new", palette.NEW, "new since the prior run"),
    ):
        mine = [change for change in changes if change.kind == kind]
        if not mine:
            continue
        half_m = 0.5 * mine[0].voxel_m
        columns = np.unique(np.concatenate([change.xyz_m[:, :2] for change in mine]).round(3), axis=0)
        squares = [Rectangle((x - half_m, y - half_m), 2 * half_m, 2 * half_m) for x, y in columns]
        drawn = PatchCollection(squares, facecolors=color, edgecolors="none", alpha=0.85, zorder=2.5)
        axes.add_collection(drawn)
        for change in mine:
            (left, low), (right, high) = change.box_m[:, :2]
            axes.add_patch(Rectangle((left, low), right - left, high - low, fill=False, ec=color, lw=1.2, zorder=2.6))
        axes.plot([], [], "s", color=color, label=label)


def _draw_regions(axes: Axes, regions: Sequence[Region], graph: VoronoiGraph | None) -> None:
    if not regions:
        return
    centres = np.array([region.centre_m[:2] for region in regions])
    if graph is not None:
        anchors = graph.vertex_xy_m[[region.vertex for region in regions]]
        ties = np.stack([centres, anchors], axis=1)
        drawn = LineCollection(list(ties), colors=palette.REGION, linewidths=0.8, linestyles="dotted")
        drawn.set_label("tie to its vertex")
        axes.add_collection(drawn)
    area = 18.0 + 60.0 * np.sqrt([region.num_members / max(r.num_members for r in regions) for region in regions])
    look: dict[str, Any] = {"color": palette.REGION, "alpha": 0.8, "edgecolors": "white", "linewidths": 0.6}
    axes.scatter(*centres.T, s=area, label="region of interest", zorder=4, **look)


def _draw_trajectory(figure: Figure, axes: Axes, poses: Sequence[Pose2 | None]) -> None:
    known = [pose for pose in poses if pose is not None]
    if not known:
        return
    xy_m = np.array([(np.nan, np.nan) if pose is None else pose.xy_m for pose in poses])
    segments = np.stack([xy_m[:-1], xy_m[1:]], axis=1)
    # No distance to or from a pose that was not known is above 0.
    moved = np.flatnonzero(np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1) > 0.0)
    drawn = LineCollection(list(segments[moved]), cmap=STEP_COLOURS, linewidths=2.0, capstyle="round", zorder=3)
    drawn.set_array(moved.astype(float))
    drawn.set_clim(0.0, float(max(1, len(poses) - 1)))
    axes.add_collection(drawn)
    figure.colorbar(drawn, ax=axes, label="trajectory: step", shrink=0.7, pad=0.01)
    first, last = known[0], known[-1]
    if len(known) > 1:
        c, s = np.cos(last.yaw_rad), np.sin(last.yaw_rad)
        arrow = ARROW @ np.array([[c, s], [-s, c]])
        axes.plot(
            *last.xy_m, marker=arrow, ms=15, ls="", color=palette.END, mec="white", mew=1.0, label="end", zorder=5
        )
    axes.plot(*first.xy_m, "o", ms=8, color=palette.START, mec="white", mew=1.0, label="start", zorder=5)
