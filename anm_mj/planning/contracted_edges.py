"""The graph with its long ways contracted: nodes at which there is something to decide, and the chains between them.

A Voronoi graph has a vertex for every few border points, and at most of them a way goes on without any choice. What is
left when these are passed over are the meet points and the boundary points of the generalized Voronoi graph (Choset and
Burdick, 2000) and the edges between them. The vertices on the way are kept in order, as the shape of each chain. All of
it takes a few passes over arrays, so that a large building costs milliseconds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order

from anm_mj.planning.connected_components import connected_components
from anm_mj.types import VoronoiGraph


@dataclass(frozen=True)
class ContractedGraph:
    """The contracted graph. Vertices are named by their indices in the graph that it was made from."""

    node: Int[np.ndarray, " k"]
    """Junctions, ends, vertices that stand alone, and the widest vertex of each circle; ascending."""
    ends: Int[np.ndarray, "c 2"]
    """The nodes that each chain begins and ends at; one node twice where it is a circle."""
    vertex: Int[np.ndarray, " v"]
    """The vertices of all chains, one chain after the other, each from end to end, nodes included."""
    start: Int[np.ndarray, " c1"]
    """Where each chain begins in ``vertex``; one more than there are chains, so that the last one ends somewhere."""
    length_m: Float[np.ndarray, " c"]


def contract(graph: VoronoiGraph, kept: Bool[np.ndarray, " n"]) -> ContractedGraph:
    """The nodes among some of a graph's vertices, and the chains of others between them.

    Args:
        graph: the road map.
        kept: vertices that count; edges to others do not.
    """
    num = len(kept)
    edge = np.flatnonzero(kept[graph.edges].all(axis=1))
    edges = graph.edges[edge]
    node = kept & (np.bincount(edges.ravel(), minlength=num) != 2)
    chain, ends = contracted_edges(edges, node)
    circle = ends[chain, 0] < 0
    if circle.any():
        vertex, of = edges[circle, 0], chain[circle]
        order = np.lexsort((vertex, -graph.clearance_m[vertex], of))
        node[vertex[order[_first(of[order])]]] = True
        chain, ends = contracted_edges(edges, node)
    vertex, start = _in_order(edges, node, chain, ends)
    length = np.bincount(chain, graph.edge_length_m[edge], len(ends)).astype(float)
    return ContractedGraph(np.flatnonzero(node), ends, vertex, start, length)


def components(graph: VoronoiGraph) -> Int[np.ndarray, " n"]:
    """For each vertex the number of the connected part that it lies in, from the one with most vertices on."""
    label = connected_components(graph.edges, len(graph.vertex_xy_m))
    return np.argsort(np.argsort(-np.bincount(label), kind="stable"))[label]


def contracted_edges(
    edges: Int[np.ndarray, "e 2"], node: Bool[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " e"], Int[np.ndarray, "c 2"]]:
    """Which chain each edge is part of, and the nodes at both ends of each chain; -1 for circles without any.

    Args:
        edges: between vertices, each of which is a node or has two edges.
        node: where chains end.
    """
    inner = ~node[edges]
    label = connected_components(edges[inner.all(axis=1)], len(node))
    # An edge from node to node is a chain by itself.
    key = np.where(inner[:, 0], label[edges[:, 0]], label[edges[:, 1]])
    direct = ~inner.any(axis=1)
    key[direct] = len(node) + np.arange(np.count_nonzero(direct))
    found, chain = np.unique(key, return_inverse=True)
    ends = np.full((len(found), 2), -1)
    at, side = np.nonzero(~inner)
    order = np.argsort(chain[at], kind="stable")
    at, side = at[order], side[order]
    ends[chain[at[::2]]] = edges[at, side].reshape(-1, 2)
    return chain, ends


def _in_order(
    edges: Int[np.ndarray, "e 2"],
    node: Bool[np.ndarray, " n"],
    chain: Int[np.ndarray, " e"],
    ends: Int[np.ndarray, "c 2"],
) -> tuple[Int[np.ndarray, " v"], Int[np.ndarray, " c1"]]:
    """The vertices of all chains from end to end, and where each chain begins among them."""
    num = len(node)
    at_node = node[edges]
    # All chains are followed at once, breadth first from a source in front of the first vertex of each.
    leads_in = np.flatnonzero(at_node.any(axis=1))
    leads_in = leads_in[np.argsort(chain[leads_in], kind="stable")]
    leads_in = leads_in[_first(chain[leads_in])]
    leads_in = leads_in[~at_node[leads_in].all(axis=1)]
    first = edges[leads_in][~at_node[leads_in]]
    within = edges[~at_node.any(axis=1)]
    rows = np.concatenate([np.full(len(first), num), within[:, 0], within[:, 1]])
    cols = np.concatenate([first, within[:, 1], within[:, 0]])
    links = coo_matrix((np.ones(len(rows)), (rows, cols)), shape=(num + 1, num + 1)).tocsr()
    inner = breadth_first_order(links, num, return_predecessors=False)[1:]
    of = np.empty(num, np.int64)
    of[edges[:, 0]] = chain
    of[edges[:, 1]] = chain
    which = np.concatenate([np.arange(len(ends)), of[inner], np.arange(len(ends))])
    vertex = np.concatenate([ends[:, 0], inner, ends[:, 1]])[np.argsort(which, kind="stable")]
    return vertex, np.concatenate([[0], np.cumsum(np.bincount(which, minlength=len(ends)))])


def _first(group: Int[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
    """Indices of the first member of each group, members of a group being next to one another."""
    return np.flatnonzero(np.append(True, group[1:] != group[:-1])[: len(group)])
