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
from scipy.spatial import KDTree

from anm_mj.frames import world_to_cell
from anm_mj.planning.contracted_edges import ContractedGraph, contracted_edges
from anm_mj.planning.distance import capped_distance_cells
from anm_mj.types import UNKNOWN, TopDownMap, VoronoiGraph

SPUR_SLOPE = 0.5
"""Clearance lost per metre along a branch into a corner of 60 degrees; blunter corners lose more."""
MAX_ROUNDS = 4
"""Pruned branches can leave others at the end of which there is nothing either; how often this is looked for."""
SPACING_M = 2.0
"""No place on what is left of the graph is farther than this from a decision vertex [m]."""
BORDER_WIDTH_M = 0.15
"""Border points this much farther from a vertex than its nearest one belong to its border too [m]."""


def decision_vertices(graph: VoronoiGraph, chains: ContractedGraph) -> Int[np.ndarray, " k"]:
    """Junctions and ends of the pruned graph, and single vertices on its long ways or alone, in ascending order.

    Args:
        graph: the road map.
        chains: what :func:`prune` has left of it, contracted.
    """
    nodes = np.unique(chains.ends)
    # Shorter chains have an end near every vertex.
    long = np.repeat(chains.length_m >= 2.0 * SPACING_M, np.diff(chains.start))
    # What is left of branches in all directions is no junction any more.
    alone = np.setdiff1d(chains.node, nodes)
    left = np.union1d(chains.vertex[long], alone)
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
    """Which vertices have the unknown next to them: it is about as near as the nearest obstacle."""
    if not len(frontier_xy_m) or not len(graph.vertex_xy_m):
        return np.zeros(len(graph.vertex_xy_m), bool)
    distance = KDTree(frontier_xy_m).query(graph.vertex_xy_m)[0]
    return np.asarray(distance <= graph.clearance_m + BORDER_WIDTH_M)


def traversable_frontier(topdown: TopDownMap, radius_m: float) -> Float[np.ndarray, "f 2"]:
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
    middle = capped_distance_cells(unknown, pad) >= radius
    # A border point lies on the edge of a cell, so that the disc's own rim is out by up to two cells.
    roomy = capped_distance_cells(~middle, pad + 2) <= radius + 1.5
    cell = world_to_cell(frontier, topdown.origin_xy_m, topdown.resolution_m) + pad
    cell = np.clip(cell, 0, np.array(roomy.shape) - 1)
    return frontier[roomy[cell[:, 0], cell[:, 1]]]


def prune(graph: VoronoiGraph, borders_unknown: Bool[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Which vertices are left without the branches into corners.

    Args:
        graph: the road map.
        borders_unknown: vertices that no branch is pruned at the end of.
    """
    kept = np.ones(len(graph.vertex_xy_m), bool)
    for _ in range(MAX_ROUNDS):
        edge = np.flatnonzero(kept[graph.edges].all(axis=1))
        edges = graph.edges[edge]
        degree = np.bincount(edges.ravel(), minlength=len(kept))
        chain, ends = contracted_edges(edges, degree != 2)
        # Circles have no ends, and the same vertex stands for both: it cannot have one edge and three.
        tip, base = np.take_along_axis(ends, np.argsort(degree[ends], axis=1), axis=1).T
        branch = (degree[tip] == 1) & (degree[base] >= 3) & ~borders_unknown[tip]
        length = np.bincount(chain, graph.edge_length_m[edge], len(ends))
        spur = branch & (graph.clearance_m[base] - graph.clearance_m[tip] >= SPUR_SLOPE * length)
        if not spur.any():
            break
        kept[edges[spur[chain]]] = False
        kept[base[spur]] = True
    return kept
