"""The generalized Voronoi graph of the known free plane.

Every point of the graph is equidistant to at least two points of the border of free space (paper, Eq. 3; Choset and
Burdick, 2000). The border is sampled at the zero-crossings of the SDF and at the frontier to the unknown: finely inside
the robot's local horizon and coarsely outside, which bounds the cost in large scenes (paper, section IV-A). The two
points that generate a Voronoi edge are the nearest of all. The clearance of a whole edge from the border points is
therefore exactly the distance from one of them to the segment. Between two samples of one wall an edge would still lead
through the wall where they lie far apart, so every edge is checked against the cells of the map as well: no thin
obstacle between two vertices is missed. The check bisects the edges (:func:`clear_edges`).
"""

import math

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import Delaunay, QhullError

from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.types import FREE, TopDownMap, VoronoiGraph

CELL_SLACK = 1.0
"""Cells round clearances down and up: an edge that keeps its distance from the border points may have so much less in
the map [cells]."""
FAR_SPACING = 2.0
"""Ratio of the spacing of far surface points to that of coarse ones."""
LEAF_CELLS = 0.25
"""Parts of edges with a shorter half than this are known by their middle: two samples per cell [cells]."""


def voronoi_graph(
    topdown: TopDownMap,
    centre_xy_m: Float[np.ndarray, "2"],
    config: PlanningConfig,
    safe_m: float,
    *,
    coarse_far_field: bool = False,
) -> VoronoiGraph:
    """The graph of the free plane whose vertices and whole edges have at least ``safe_m`` clearance [m].

    ``centre_xy_m`` is the centre of the local horizon [m]; with ``coarse_far_field`` the border is sampled yet more
    coarsely far beyond it.
    """
    sites = border_sites(topdown, centre_xy_m, config, coarse_far_field=coarse_far_field)
    if len(sites) < 4:
        return _empty_graph()
    try:
        diagram = Delaunay(sites)
    except QhullError:  # All sites on one line: there is no vertex.
        return _empty_graph()
    # The Voronoi diagram is the dual of the triangulation: a vertex per triangle, an edge per pair of neighbours, which
    # the two sites that they share generate. This costs half of computing the diagram itself.
    vertices = _circumcentres(sites[diagram.simplices])
    free = _in_free_space(vertices, topdown)
    beyond = diagram.neighbors > np.arange(len(vertices))[:, None]
    triangle, corner = np.nonzero(beyond & free[:, None] & free[diagram.neighbors])
    a, b = (sites[diagram.simplices[triangle, (corner + k) % 3]] for k in (1, 2))
    # The two sides of a passage that a narrow robot fits through may be nearer to each other than that.
    usable = _length(a - b) >= min(config.min_site_distance_m, 2.0 * safe_m)
    ridges, a = np.stack([triangle, diagram.neighbors[triangle, corner]], axis=1)[usable], a[usable]
    usable = _segment_distance(a, vertices[ridges[:, 0]], vertices[ridges[:, 1]]) >= safe_m
    ridges, a = ridges[usable], a[usable]
    least_m = max(safe_m - CELL_SLACK * topdown.resolution_m, topdown.resolution_m / 2.0)
    usable = clear_edges(topdown, vertices[ridges[:, 0]], vertices[ridges[:, 1]], least_m)
    ridges, a = ridges[usable], a[usable]
    used = np.flatnonzero(np.bincount(ridges.ravel(), minlength=len(vertices)))
    number = np.zeros(len(vertices), np.int64)
    number[used] = np.arange(len(used))
    xy, edges = vertices[used], number[ridges]
    start, end = xy[edges[:, 0]], xy[edges[:, 1]]
    clearance = np.empty(len(xy))
    clearance[edges[:, 0]], clearance[edges[:, 1]] = _length(start - a), _length(end - a)
    return VoronoiGraph(xy, clearance, edges, _length(start - end))


def border_sites(
    topdown: TopDownMap, centre_xy_m: Float[np.ndarray, "2"], config: PlanningConfig, *, coarse_far_field: bool = False
) -> Float[np.ndarray, "n 2"]:
    """Samples of the border of free space, one per fine or coarse square; far squares can be coarser still [m]."""
    border = np.concatenate([topdown.surface_xy_m, topdown.frontier_xy_m])
    if not len(border):
        return border
    off = np.maximum(*np.abs(border - centre_xy_m).T)
    inside = off <= config.horizon_m / 2
    far = (off > config.far_m) & coarse_far_field
    kept = [
        _one_per_square(border[inside], config.fine_spacing_m),
        _one_per_square(border[~inside & ~far], config.coarse_spacing_m),
        _one_per_square(border[far], FAR_SPACING * config.coarse_spacing_m),
    ]
    return np.concatenate(kept)


def clear_edges(
    topdown: TopDownMap, start_xy_m: Float[np.ndarray, "n 2"], end_xy_m: Float[np.ndarray, "n 2"], least_m: float
) -> Bool[np.ndarray, " n"]:
    """Whether each edge between world points keeps a clearance on all of its length [m]; few samples each.

    The clearance changes along an edge no faster than the edge is long. An edge whose middle is farther from all
    obstacles than half its length and the clearance asked for is clear as a whole; one whose middle is too near to an
    obstacle is not; all others are two edges of half the length.

    ``least_m`` is the clearance asked for, to cells that are occupied or unknown; it is more than half a cell, so that
    no obstacle fits between two samples. What lies outside of the map is not free.
    """
    resolution = topdown.resolution_m
    rows, cols = topdown.clearance_m.shape
    clearance = topdown.clearance_m.ravel()
    clear = np.ones(len(start_xy_m), bool)
    start = (start_xy_m - topdown.origin_xy_m) / resolution
    along = (end_xy_m - start_xy_m) / resolution
    half = np.hypot(along[:, 0], along[:, 1]) / 2.0
    middle = (start + along / 2.0).T
    step = (along / 4.0).T
    which: Int[np.ndarray, " p"] = np.arange(len(start))
    while len(which):
        x, y = middle
        inside = (x >= 0.0) & (x < cols) & (y >= 0.0) & (y < rows)
        cell = np.where(inside, y, 0.0).astype(np.int64) * cols + np.where(inside, x, 0.0).astype(np.int64)
        here = np.where(inside, clearance[cell], -np.inf)
        clear[which[here < least_m]] = False
        # The middle and the nearest point of the obstacle may each lie anywhere in its cell.
        open_ = here >= least_m + (half + math.sqrt(2.0)) * resolution
        split = np.flatnonzero(~open_ & (half > LEAF_CELLS) & clear[which])
        middle, step = middle[:, split], step[:, split]
        middle = np.concatenate([middle - step, middle + step], axis=1)
        step = np.tile(step / 2.0, 2)
        which, half = np.tile(which[split], 2), np.tile(half[split] / 2.0, 2)
    return clear


def _empty_graph() -> VoronoiGraph:
    return VoronoiGraph(np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2), np.int64), np.zeros(0))


def _one_per_square(points: Float[np.ndarray, "n 2"], spacing_m: float) -> Float[np.ndarray, "m 2"]:
    if not len(points):
        return points
    # The member nearest to the mean of its square: otherwise the staircases of grid borders would bend the graph.
    col, row = np.floor(points / spacing_m).astype(np.int64).T
    row = row - row.min()
    # Numbered without gaps, so that a large scene costs no more than its border.
    _, square = np.unique((col - col.min()) * (row.max() + 1) + row, return_inverse=True)
    size = np.bincount(square)
    mean = np.stack([np.bincount(square, along) / size for along in points.T], axis=1)
    off = _squared(points - mean[square])
    least = np.full(len(size), np.inf)
    np.minimum.at(least, square, off)
    # The first of equally near ones is written last.
    nearest = np.flatnonzero(off == least[square])[::-1]
    chosen = np.empty(len(size), np.int64)
    chosen[square[nearest]] = nearest
    return points[chosen]


def _circumcentres(corners: Float[np.ndarray, "n 3 2"]) -> Float[np.ndarray, "n 2"]:
    """Centres of the circumcircles of triangles; not finite where the corners lie on one line."""
    first = corners[:, 0]
    b, c = corners[:, 1] - first, corners[:, 2] - first
    twice_area = 2.0 * (b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])
    bb, cc = _squared(b), _squared(c)
    with np.errstate(divide="ignore", invalid="ignore"):
        x = (c[:, 1] * bb - b[:, 1] * cc) / twice_area
        y = (b[:, 0] * cc - c[:, 0] * bb) / twice_area
    return first + np.stack([x, y], axis=1)


def _in_free_space(points: Float[np.ndarray, "n 2"], topdown: TopDownMap) -> Bool[np.ndarray, " n"]:
    rows, cols = topdown.state.shape
    # Vertices of nearly parallel ridges lie arbitrarily far away and would overflow an integer.
    x, y = ((points - topdown.origin_xy_m) / topdown.resolution_m).T
    free = (x >= 0) & (x < cols) & (y >= 0) & (y < rows)
    free[free] = topdown.state[y[free].astype(np.int64), x[free].astype(np.int64)] == FREE
    return free


def _segment_distance(
    point: Float[np.ndarray, "n 2"], start: Float[np.ndarray, "n 2"], end: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, " n"]:
    along = end - start
    t = np.clip(((point - start) * along).sum(axis=1) / np.maximum(_squared(along), 1e-18), 0.0, 1.0)
    return _length(start + t[:, None] * along - point)


def _squared(vector: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
    return vector[:, 0] ** 2 + vector[:, 1] ** 2


def _length(vector: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
    return np.sqrt(_squared(vector))
