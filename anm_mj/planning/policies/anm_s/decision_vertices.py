"""Decision vertices: the vertices of the graph where paths meet, where they end, and a few on long paths between."""

import numpy as np
from jaxtyping import Bool, Int
from scipy.spatial import KDTree

from anm_mj.planning.policies.anm_s.contracted_edges import contracted_edges
from anm_mj.types import VoronoiGraph

SPACING_M = 2.0
"""No place on the pruned graph is farther than this from a decision vertex [m]."""


def decision_vertices(graph: VoronoiGraph, kept: Bool[np.ndarray, " n"]) -> Int[np.ndarray, " k"]:
    """Nodes of the pruned graph, and vertices on its long edges and in its small parts, in ascending order.

    Args:
        graph: the road map.
        kept: vertices that :func:`~anm_mj.planning.policies.anm_s.spurs.prune_spurs` left.
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
