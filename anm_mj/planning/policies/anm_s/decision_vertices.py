"""Decision vertices: the vertices of the graph where paths meet, where they end, and a few on long paths between.

A Voronoi diagram has a branch, a spur, into every corner and at every unevenness of a wall. The robot sees its end from
its beginning, so there is nothing to decide. Spurs are known by how fast the clearance falls along them. A branch that
ends at the unknown may go on and is kept, provided the robot fits into the unknown; between furniture and the edge of
its shadow it does not.

A Voronoi graph has a vertex for every few border points, and most have two edges. Without these, the meet points
and the boundary points of the generalized Voronoi graph remain (Choset and Burdick, 2000): the contracted graph, of
nodes where paths meet or end, and one edge for all vertices in a row between two nodes. All of it takes a few passes
over arrays: milliseconds for a large building.
"""

import numpy as np
from jaxtyping import Bool, Int
from scipy.spatial import KDTree

from anm_mj.geometry.connected_components import connected_components
from anm_mj.types import VoronoiGraph

SPUR_SLOPE = 0.5
"""Clearance lost per metre along a spur into a corner of 60 degrees; blunter corners lose more."""
MAX_ROUNDS = 4
"""Pruned spurs can leave others; most rounds of pruning."""
SPACING_M = 2.0
"""No place on the pruned graph is farther than this from a decision vertex [m]."""


def prune_spurs(graph: VoronoiGraph, borders_unknown: Bool[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Which vertices are left without the spurs; vertices beside the unknown keep the branches that end there."""
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


def decision_vertices(graph: VoronoiGraph, kept: Bool[np.ndarray, " n"]) -> Int[np.ndarray, " k"]:
    """Nodes of the pruned graph, and vertices on its long edges and in its small parts, in ascending order.

    ``kept`` are the vertices that :func:`prune_spurs` left.
    """
    used = kept[graph.edges].all(axis=1)
    edges = graph.edges[used]
    is_node = kept & (np.bincount(edges.ravel(), minlength=len(kept)) != 2)
    contracted, ends = contracted_edges(edges, is_node)
    circle = ends[contracted, 0] < 0
    if circle.any():
        # A circle gets a node, its widest vertex.
        vertex, number = edges[circle, 0], contracted[circle]
        order = np.lexsort((vertex, -graph.clearance_m[vertex], number))
        is_node[vertex[order[np.unique(number[order], return_index=True)[1]]]] = True
        contracted, ends = contracted_edges(edges, is_node)
    nodes = np.unique(ends)
    # Shorter edges have an end near every vertex.
    long = np.bincount(contracted, graph.edge_length_m[used], len(ends)) >= 2.0 * SPACING_M
    # Where all branches were spurs, a vertex without edges remains.
    alone = np.setdiff1d(np.flatnonzero(is_node), nodes)
    left = np.union1d(edges[long[contracted]], alone)
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


def contracted_edges(
    edges: Int[np.ndarray, "e 2"], node: Bool[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " e"], Int[np.ndarray, "c 2"]]:
    """The contracted edge that contains each edge, and the nodes at both ends of each; -1 for circles without a node.

    A vertex that is no node has two edges.
    """
    inner = ~node[edges]
    label = connected_components(edges[inner.all(axis=1)], len(node))
    # An edge from node to node stays an edge of its own.
    key = np.where(inner[:, 0], label[edges[:, 0]], label[edges[:, 1]])
    direct = ~inner.any(axis=1)
    key[direct] = len(node) + np.arange(np.count_nonzero(direct))
    found, contracted = np.unique(key, return_inverse=True)
    ends = np.full((len(found), 2), -1)
    at, side = np.nonzero(~inner)
    order = np.argsort(contracted[at], kind="stable")
    at, side = at[order], side[order]
    ends[contracted[at[::2]]] = edges[at, side].reshape(-1, 2)
    return contracted, ends
