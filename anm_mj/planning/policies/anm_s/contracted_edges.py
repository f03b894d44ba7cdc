"""The contracted graph: nodes where paths meet or end, and one edge for all vertices in a row between two nodes.

A Voronoi graph has a vertex for every few border points, and most have two edges. Without these, the meet points
and the boundary points of the generalized Voronoi graph remain (Choset and Burdick, 2000). All of it takes a few passes
over arrays: milliseconds for a large building.
"""

import numpy as np
from jaxtyping import Bool, Int

from anm_mj.geometry.connected_components import connected_components


def contracted_edges(
    edges: Int[np.ndarray, "e 2"], node: Bool[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " e"], Int[np.ndarray, "c 2"]]:
    """The contracted edge that contains each edge, and the nodes at both ends of each; -1 for circles without a node.

    Args:
        edges: between vertices, each of which is a node or has two edges.
        node: where contracted edges end.
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
