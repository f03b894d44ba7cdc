"""The contracted graph: nodes where paths meet or end, and one edge for all vertices in a row between two nodes.

A Voronoi graph has a vertex for every few border points, and most have two edges. Without these, the meet points
and the boundary points of the generalized Voronoi graph remain (Choset and Burdick, 2000). Each contracted edge keeps
its vertices in order, as its shape. All of it takes a few passes over arrays: milliseconds for a large building.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order

from anm_mj.geometry.connected_components import connected_components
from anm_mj.types import VoronoiGraph


@dataclass(frozen=True)
class ContractedGraph:
    """Nodes and contracted edges; vertices are indices into the graph that was contracted."""

    node: Int[np.ndarray, " k"]
    """Vertices with one edge, with three or more, or with none, and the widest vertex of each circle; ascending."""
    ends: Int[np.ndarray, "c 2"]
    """The nodes at both ends of each edge; twice the same one for a circle."""
    vertex: Int[np.ndarray, " v"]
    """The vertices of all edges, one edge after the other, each from end to end with its nodes."""
    start: Int[np.ndarray, " c1"]
    """Where each edge begins in ``vertex``, and at the end the length of ``vertex``."""
    length_m: Float[np.ndarray, " c"]


def contract(graph: VoronoiGraph, kept: Bool[np.ndarray, " n"]) -> ContractedGraph:
    """Contract a part of a graph.

    Args:
        graph: the road map.
        kept: vertices of the part; edges to others are left out.
    """
    num = len(kept)
    edge = np.flatnonzero(kept[graph.edges].all(axis=1))
    edges = graph.edges[edge]
    node = kept & (np.bincount(edges.ravel(), minlength=num) != 2)
    contracted, ends = contracted_edges(edges, node)
    circle = ends[contracted, 0] < 0
    if circle.any():
        vertex, of = edges[circle, 0], contracted[circle]
        order = np.lexsort((vertex, -graph.clearance_m[vertex], of))
        node[vertex[order[_first(of[order])]]] = True
        contracted, ends = contracted_edges(edges, node)
    vertex, start = _in_order(edges, node, contracted, ends)
    length = np.bincount(contracted, graph.edge_length_m[edge], len(ends)).astype(float)
    return ContractedGraph(np.flatnonzero(node), ends, vertex, start, length)


def components(graph: VoronoiGraph) -> Int[np.ndarray, " n"]:
    """The connected component of each vertex; component 0 has most vertices, and so on."""
    label = connected_components(graph.edges, len(graph.vertex_xy_m))
    return np.argsort(np.argsort(-np.bincount(label), kind="stable"))[label]


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


def _in_order(
    edges: Int[np.ndarray, "e 2"],
    node: Bool[np.ndarray, " n"],
    contracted: Int[np.ndarray, " e"],
    ends: Int[np.ndarray, "c 2"],
) -> tuple[Int[np.ndarray, " v"], Int[np.ndarray, " c1"]]:
    """The vertices of all contracted edges from end to end, and where each edge begins among them."""
    num = len(node)
    at_node = node[edges]
    # One breadth-first search follows all edges at once, from an extra source before the first vertex of each.
    entry = np.flatnonzero(at_node.any(axis=1))
    entry = entry[np.argsort(contracted[entry], kind="stable")]
    entry = entry[_first(contracted[entry])]
    entry = entry[~at_node[entry].all(axis=1)]
    first = edges[entry][~at_node[entry]]
    within = edges[~at_node.any(axis=1)]
    rows = np.concatenate([np.full(len(first), num), within[:, 0], within[:, 1]])
    cols = np.concatenate([first, within[:, 1], within[:, 0]])
    links = coo_matrix((np.ones(len(rows)), (rows, cols)), shape=(num + 1, num + 1)).tocsr()
    inner = breadth_first_order(links, num, return_predecessors=False)[1:]
    of = np.empty(num, np.int64)
    of[edges[:, 0]] = contracted
    of[edges[:, 1]] = contracted
    which = np.concatenate([np.arange(len(ends)), of[inner], np.arange(len(ends))])
    vertex = np.concatenate([ends[:, 0], inner, ends[:, 1]])[np.argsort(which, kind="stable")]
    return vertex, np.concatenate([[0], np.cumsum(np.bincount(which, minlength=len(ends)))])


def _first(group: Int[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
    """Indices of the first member of each group; the members of a group lie in a row."""
    return np.flatnonzero(np.append(True, group[1:] != group[:-1])[: len(group)])
