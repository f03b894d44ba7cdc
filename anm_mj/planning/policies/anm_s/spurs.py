"""Spurs: branches of the graph that lead into a corner and need no decision.

A Voronoi diagram has a branch, a spur, into every corner and at every unevenness of a wall. The robot sees its end from
its beginning. Spurs are known by how fast the clearance falls along them. A branch that ends at the unknown may go on
and is kept, provided the robot fits into the unknown; between furniture and the edge of its shadow it does not.
"""

import numpy as np
from jaxtyping import Bool

from anm_mj.planning.policies.anm_s.contracted_edges import contracted_edges
from anm_mj.types import VoronoiGraph

SPUR_SLOPE = 0.5
"""Clearance lost per metre along a spur into a corner of 60 degrees; blunter corners lose more."""
MAX_ROUNDS = 4
"""Pruned spurs can leave others; most rounds of pruning."""


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
