"""Decision vertices: the vertices of the graph where paths meet, where they end, and a few on long paths between.

Spurs are pruned before degrees are counted (:mod:`anm_mj.planning.policies.anm_s.spurs`). Long paths without a node,
and circles, get vertices on them, so that every place is near one.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Int
from scipy.spatial import KDTree

from anm_mj.planning.policies.anm_s.contracted_edges import ContractedGraph
from anm_mj.types import VoronoiGraph

SPACING_M = 2.0
"""No place on the pruned graph is farther than this from a decision vertex [m]."""


def decision_vertices(graph: VoronoiGraph, contracted: ContractedGraph) -> Int[np.ndarray, " k"]:
    """Nodes of the pruned graph, and vertices on its long edges and in its small parts, in ascending order.

    Args:
        graph: the road map.
        contracted: the rest of it after :func:`~anm_mj.planning.policies.anm_s.spurs.prune_spurs`, contracted.
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
