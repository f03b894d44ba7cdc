"""The vertices of the graph at which there is something to decide: where ways meet and where they end.

A Voronoi diagram has a branch into every corner and at every unevenness of a wall. Nothing is decided at these: what
they lead to is seen from where they begin. They are known by how fast the clearance falls along them, and are pruned
before degrees are counted. A branch that ends at the unknown is never pruned, because it may go on there: if the robot
would fit in, which it does not between furniture and the edge of its shadow. Long ways
without any junction, and ways in a circle, get vertices on them, so that every place is near one.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage
from scipy.spatial import KDTree

from anm_mj.frames import world_to_cell
from anm_mj.types import UNKNOWN, TopDownMap, VoronoiGraph

SPUR_SLOPE = 0.5
"""Clearance lost per metre along a branch into a corner of 60 degrees; blunter corners lose more."""
MAX_ROUNDS = 4
"""Pruned branches can leave others at the end of which there is nothing either; how often this is looked for."""
SPACING_M = 2.0
"""No place on what is left of the graph is farther than this from a decision vertex [m]."""
BORDER_WIDTH_M = 0.15
"""Border points this much farther from a vertex than its nearest one belong to its border too [m]."""


def decision_vertices(graph: VoronoiGraph, frontier_xy_m: Float[np.ndarray, "f 2"]) -> Int[np.ndarray, " k"]:
    """Junctions and ends of the pruned graph, and single vertices on its long ways, in ascending order.

    Args:
        graph: the road map.
        frontier_xy_m: border of the unknown [m].
    """
    kept, degree = prune(graph, leads_on(graph, frontier_xy_m))
    chosen = kept & ((degree >= 3) | (degree == 1))
    for vertex in np.argsort(-graph.clearance_m, kind="stable"):
        if kept[vertex] and not chosen[vertex]:
            away = np.linalg.norm(graph.vertex_xy_m[chosen] - graph.vertex_xy_m[vertex], axis=1)
            chosen[vertex] = not (away < SPACING_M).any()
    return np.flatnonzero(chosen)


def leads_on(graph: VoronoiGraph, frontier_xy_m: Float[np.ndarray, "f 2"]) -> Bool[np.ndarray, " n"]:
    """Which vertices have the unknown next to them: it is about as near as the nearest obstacle."""
    if not len(frontier_xy_m) or not len(graph.vertex_xy_m):
        return np.zeros(len(graph.vertex_xy_m), bool)
    distance = KDTree(frontier_xy_m).query(graph.vertex_xy_m)[0]
    return np.asarray(distance <= graph.clearance_m + BORDER_WIDTH_M)


def roomy_frontier(topdown: TopDownMap, radius_m: float) -> Float[np.ndarray, "f 2"]:
    """The border of that unknown which a disc fits into [m]; what lies outside of the map is unknown.

    Args:
        topdown: the map.
        radius_m: of the disc [m].
    """
    frontier = topdown.frontier_xy_m
    if not len(frontier):
        return frontier
    radius = radius_m / topdown.resolution_m
    pad = int(np.ceil(radius)) + 1
    unknown = np.pad(topdown.state == UNKNOWN, pad, constant_values=True)
    middle = np.asarray(ndimage.distance_transform_edt(unknown)) >= radius
    # A border point lies on the edge of a cell, so that the disc's own rim is out by up to two cells.
    roomy = np.asarray(ndimage.distance_transform_edt(~middle)) <= radius + 1.5
    cell = world_to_cell(frontier, topdown.origin_xy_m, topdown.resolution_m) + pad
    cell = np.clip(cell, 0, np.array(roomy.shape) - 1)
    return frontier[roomy[cell[:, 0], cell[:, 1]]]


def prune(
    graph: VoronoiGraph, leads_on: Bool[np.ndarray, " n"]
) -> tuple[Bool[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Which vertices are left without the branches into corners, and how many edges each has then.

    Args:
        graph: the road map.
        leads_on: vertices that no branch is pruned at the end of.
    """
    n = len(graph.vertex_xy_m)
    neighbours: list[list[int]] = [[] for _ in range(n)]
    for a, b in graph.edges.tolist():
        neighbours[a].append(b)
        neighbours[b].append(a)
    kept = np.ones(n, bool)
    degree = graph.degree.copy()
    for _ in range(MAX_ROUNDS):
        spurs = [
            (branch, junction)
            for leaf in np.flatnonzero(kept & (degree == 1) & ~leads_on).tolist()
            if (found := _branch(leaf, neighbours, kept, degree)) is not None
            for branch, junction in (found,)
            if _is_spur(graph, branch, junction)
        ]
        if not spurs:
            break
        for branch, junction in spurs:
            kept[branch] = False
            degree[branch] = 0
            degree[junction] -= 1
    return kept, degree


def _branch(
    leaf: int, neighbours: list[list[int]], kept: Bool[np.ndarray, " n"], degree: Int[np.ndarray, " n"]
) -> tuple[list[int], int] | None:
    """The vertices from an end to the next junction, and that junction; None where the way has two ends."""
    branch, before = [leaf], -1
    while True:
        (after,) = [v for v in neighbours[branch[-1]] if kept[v] and v != before]
        if degree[after] != 2:
            return (branch, after) if degree[after] > 2 else None
        before = branch[-1]
        branch.append(after)


def _is_spur(graph: VoronoiGraph, branch: list[int], junction: int) -> bool:
    xy = graph.vertex_xy_m[[*branch, junction]]
    length = float(np.linalg.norm(np.diff(xy, axis=0), axis=1).sum())
    return bool(graph.clearance_m[junction] - graph.clearance_m[branch[0]] >= SPUR_SLOPE * length)
