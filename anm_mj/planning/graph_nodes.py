"""Decision vertices: the vertices of the graph where paths meet, where they end, and a few on long paths between.

A Voronoi diagram has a branch, a spur, into every corner and at every unevenness of a wall. A spur needs no decision:
the robot sees its end from its beginning. Spurs are known by how fast the clearance falls along them, and are pruned
before degrees are counted. A branch that ends at the unknown may go on and is kept, provided the robot fits into the
unknown; between furniture and the edge of its shadow it does not. Long paths without a node, and circles, get vertices
on them, so that every place is near one.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from anm_mj.frames import world_to_cell
from anm_mj.planning.contracted_edges import ContractedGraph, contracted_edges
from anm_mj.planning.distance import capped_distance_cells
from anm_mj.types import UNKNOWN, TopDownMap, VoronoiGraph

SPUR_SLOPE = 0.5
"""Clearance lost per metre along a spur into a corner of 60 degrees; blunter corners lose more."""
MAX_ROUNDS = 4
"""Pruned spurs can leave others; most rounds of pruning."""
SPACING_M = 2.0
"""No place on the pruned graph is farther than this from a decision vertex [m]."""
BORDER_WIDTH_M = 0.15
"""A vertex borders on points that are up to this much farther away than its nearest border point [m]."""


def decision_vertices(graph: VoronoiGraph, contracted: ContractedGraph) -> Int[np.ndarray, " k"]:
    """Nodes of the pruned graph, and vertices on its long edges and in its small parts, in ascending order.

    Args:
        graph: the road map.
        contracted: the rest of it after :func:`prune_spurs`, contracted.
    """
    nodes = np.unique(contracted.ends)
    # Shorter edges have an end near every vertex.
    long = np.repeat(contracted.length_m >= 2.0 * SPACING_M, np.diff(contracted.start))
    # Where all branches were spurs, a vertex without edges remains.
    alone = np.setdiff1d(contracted.node, nodes)
    left = np.union1d(contracted.vertex[long], alone)
    away = KDTree(graph.vertex_xy_m[nodes]).query(graph.vertex_xy_m[left], distance_upper_bound=SPACING_M)[0]
    left = left[np.isinf(away)]
    left = left[np.argsort(-graph.clearance_m[left], kind="stable")]
    chosen = [nodes]
    tree, free = KDTree(graph.vertex_xy_m[left]), np.ones(len(left), bool)
    for i, vertex in enumerate(left):
        if free[i]:
            chosen.append(left[i : i + 1])
            free[tree.query_ball_point(graph.vertex_xy_m[vertex], SPACING_M)] = False
    return np.sort(np.concatenate(chosen))


def borders_unknown(graph: VoronoiGraph, frontier_xy_m: Float[np.ndarray, "f 2"]) -> Bool[np.ndarray, " n"]:
    """Which vertices border on the unknown: it is about as near as the nearest obstacle."""
    if not len(frontier_xy_m) or not len(graph.vertex_xy_m):
        return np.zeros(len(graph.vertex_xy_m), bool)
    distance = KDTree(frontier_xy_m).query(graph.vertex_xy_m)[0]
    return np.asarray(distance <= graph.clearance_m + BORDER_WIDTH_M)


def traversable_frontier(topdown: TopDownMap, radius_m: float) -> Float[np.ndarray, "f 2"]:
    """The border of the unknown where a disc fits into it [m]; places outside of the map are unknown.

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
    middle = capped_distance_cells(unknown, pad) >= radius
    # A border point lies on the edge of a cell, so that the disc's own rim is off by up to two cells.
    traversable = capped_distance_cells(~middle, pad + 2) <= radius + 1.5
    cell = world_to_cell(frontier, topdown.origin_xy_m, topdown.resolution_m) + pad
    cell = np.clip(cell, 0, np.array(traversable.shape) - 1)
    return frontier[traversable[cell[:, 0], cell[:, 1]]]


def prune_spurs(graph: VoronoiGraph, borders_unknown: Bool[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Which vertices are left without the spurs.

    Args:
        graph: the road map.
        borders_unknown: vertices that keep the branches which end at them.
    """
    kept = np.ones(len(graph.vertex_xy_m), bool)
    for _ in range(MAX_ROUNDS):
        edge = np.flatnonzero(kept[graph.edges].all(axis=1))
        edges = graph.edges[edge]
        degree = np.bincount(edges.ravel(), minlength=len(kept))
        contracted, ends = contracted_edges(edges, degree != 2)
        # A circle has no ends (-1, -1): the same vertex stands for both and cannot have one edge and three.
        tip, base = np.take_along_axis(ends, np.argsort(degree[ends], axis=1), axis=1).T
        branch = (degree[tip] == 1) & (degree[base] >= 3) & ~borders_unknown[tip]
        length = np.bincount(contracted, graph.edge_length_m[edge], len(ends))
        spur = branch & (graph.clearance_m[base] - graph.clearance_m[tip] >= SPUR_SLOPE * length)
        if not spur.any():
            break
        kept[edges[spur[contracted]]] = False
        kept[base[spur]] = True
    return kept
