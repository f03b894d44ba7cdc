"""The generalized Voronoi graph of the known free plane.

Every point of the graph is equidistant to at least two points of the border of free space (paper, eq. 8; Choset and
Burdick, 2000). The border is sampled: zero-crossings of the SDF, and the frontier to the unknown, finely inside the
robot's local horizon and coarsely outside, so that the cost stays bounded in large scenes (paper, section IV-A). On a
Voronoi edge the two generating points are the nearest of all, so that the clearance of a whole edge is exactly the
distance from one of them to the segment: no thin obstacle is missed between two vertices.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import Delaunay, QhullError

from anm_mj.frames import world_to_cell
from anm_mj.planning.config import PlanningConfig
from anm_mj.types import FREE, TopDownMap, VoronoiGraph

FAR_SPACING = 2.0
"""Far surface points lie so many times as far apart as coarse ones."""


def voronoi_graph(
    topdown: TopDownMap,
    centre_xy_m: Float[np.ndarray, 2],
    config: PlanningConfig,
    safe_m: float,
    *,
    thin_far: bool = False,
) -> VoronoiGraph:
    """The graph of all places with at least ``safe_m`` clearance.

    Args:
        topdown: the map.
        centre_xy_m: centre of the local horizon [m].
        config: spacings and horizon.
        safe_m: least clearance of vertices and of whole edges [m].
        thin_far: whether the border is sampled yet more coarsely far beyond the horizon.
    """
    sites = border_sites(topdown, centre_xy_m, config, thin_far=thin_far)
    if len(sites) < 4:
        return _empty_graph()
    try:
        diagram = Delaunay(sites)
    except QhullError:  # All sites on one line: there is no vertex.
        return _empty_graph()
    # The Voronoi diagram is the triangulation's dual: a vertex per triangle, an edge per pair of neighbours, generated
    # by the two sites that they share. Taken so, it costs half.
    triangle, corner = np.nonzero(diagram.neighbors > np.arange(len(diagram.simplices))[:, None])
    ridges = np.stack([triangle, diagram.neighbors[triangle, corner]], axis=1)
    a_b = np.stack([diagram.simplices[triangle, (corner + k) % 3] for k in (1, 2)], axis=1)
    usable = np.linalg.norm(sites[a_b[:, 0]] - sites[a_b[:, 1]], axis=1) >= config.min_site_distance_m
    vertices = _circumcentres(sites[diagram.simplices])
    usable &= _in_free_space(vertices, topdown)[ridges].all(axis=1)
    ridges, a_b = ridges[usable], a_b[usable]
    start, end = vertices[ridges[:, 0]], vertices[ridges[:, 1]]
    usable = _segment_distance(sites[a_b[:, 0]], start, end) >= safe_m
    ridges, a_b = ridges[usable], a_b[usable]
    if not len(ridges):
        return _empty_graph()
    used, edges = np.unique(ridges, return_inverse=True)
    edges = edges.reshape(-1, 2)
    xy = vertices[used]
    clearance = np.empty(len(xy))
    for side in (0, 1):
        clearance[edges[:, side]] = np.linalg.norm(xy[edges[:, side]] - sites[a_b[:, 0]], axis=1)
    length = np.linalg.norm(xy[edges[:, 0]] - xy[edges[:, 1]], axis=1)
    return VoronoiGraph(xy, clearance, edges.astype(np.int64), length)


def border_sites(
    topdown: TopDownMap, centre_xy_m: Float[np.ndarray, 2], config: PlanningConfig, *, thin_far: bool = False
) -> Float[np.ndarray, "n 2"]:
    """Samples of the border of free space, one per fine or coarse square [m]; far ones may be coarser still."""
    border = np.concatenate([topdown.surface_xy_m, topdown.frontier_xy_m])
    if not len(border):
        return border
    off = np.abs(border - centre_xy_m).max(axis=1)
    inside = off <= config.horizon_m / 2
    far = (off > config.far_m) & thin_far
    kept = [
        _one_per_square(border[inside], config.fine_spacing_m),
        _one_per_square(border[~inside & ~far], config.coarse_spacing_m),
        _one_per_square(border[far], FAR_SPACING * config.coarse_spacing_m),
    ]
    return np.concatenate(kept)


def _empty_graph() -> VoronoiGraph:
    return VoronoiGraph(np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2), np.int64), np.zeros(0))


def _one_per_square(points: Float[np.ndarray, "n 2"], spacing_m: float) -> Float[np.ndarray, "m 2"]:
    if not len(points):
        return points
    # The member nearest to its square's mean: staircases of grid borders would otherwise bend the graph.
    keys = np.floor(points / spacing_m).astype(np.int64)
    keys -= keys.min(axis=0)
    key = keys[:, 0] * (keys[:, 1].max() + 1) + keys[:, 1]
    _, group = np.unique(key, return_inverse=True)
    size = np.bincount(group)
    mean = np.stack([np.bincount(group, points[:, i]) / size for i in (0, 1)], axis=1)
    order = np.lexsort((((points - mean[group]) ** 2).sum(axis=1), group))
    first = np.concatenate([[0], np.cumsum(size)[:-1]])
    return points[order[first]]


def _circumcentres(corners: Float[np.ndarray, "n 3 2"]) -> Float[np.ndarray, "n 2"]:
    """Centres of the circles through triangles' corners; not finite where the corners lie on one line."""
    first = corners[:, 0]
    b, c = corners[:, 1] - first, corners[:, 2] - first
    twice_area = 2.0 * (b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])
    bb, cc = (b**2).sum(axis=1), (c**2).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        x = (c[:, 1] * bb - b[:, 1] * cc) / twice_area
        y = (b[:, 0] * cc - c[:, 0] * bb) / twice_area
    return first + np.stack([x, y], axis=1)


def _in_free_space(points: Float[np.ndarray, "n 2"], topdown: TopDownMap) -> Bool[np.ndarray, " n"]:
    rows, cols = topdown.state.shape
    span = np.array([cols, rows]) * topdown.resolution_m
    # Vertices of nearly parallel ridges lie arbitrarily far away and would overflow an integer.
    inside = ((points >= topdown.origin_xy_m) & (points < topdown.origin_xy_m + span)).all(axis=1)
    free = np.zeros(len(points), bool)
    cell = world_to_cell(points[inside], topdown.origin_xy_m, topdown.resolution_m)
    cell = np.minimum(cell, [rows - 1, cols - 1])
    free[inside] = topdown.state[cell[:, 0], cell[:, 1]] == FREE
    return free


def _segment_distance(
    point: Float[np.ndarray, "n 2"], start: Float[np.ndarray, "n 2"], end: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, " n"]:
    along = end - start
    squared = np.maximum((along**2).sum(axis=1), 1e-18)
    t = np.clip(((point - start) * along).sum(axis=1) / squared, 0.0, 1.0)
    return np.linalg.norm(start + t[:, None] * along - point, axis=1)
