import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anm_mj.planning.config import PlanningConfig
from anm_mj.planning.contracted_edges import components, contract
from anm_mj.planning.graph_nodes import borders_unknown, prune
from anm_mj.planning.voronoi_graph import voronoi_graph
from anm_mj.types import FREE, TopDownMap, VoronoiGraph
from tests.planning.worlds import room, see


def graph_of(places, edges, clearance=None):
    xy = np.array(places, float).reshape(-1, 2)
    edges = np.array(edges, np.int64).reshape(-1, 2)
    length = np.linalg.norm(xy[edges[:, 0]] - xy[edges[:, 1]], axis=1)
    return VoronoiGraph(xy, np.ones(len(xy)) if clearance is None else np.array(clearance, float), edges, length)


def all_of(graph):
    return contract(graph, np.ones(len(graph.vertex_xy_m), bool))


def along(chains, chain):
    """The vertices of one chain from end to end."""
    return chains.vertex[chains.start[chain] : chains.start[chain + 1]]


def contracted(world, x, y):
    """The contracted graph of a world without its spurs, and the graph."""
    graph, topdown = see(world, x, y)
    return contract(graph, prune(graph, borders_unknown(graph, topdown.frontier_xy_m))), graph


def test_a_way_without_a_junction_is_one_chain_with_its_vertices_in_order():
    # The vertices' numbers say nothing of their order along the way: 3, 0, 4, 1, 2.
    graph = graph_of([(1, 0), (3, 0), (3, 2), (0, 0), (2, 0)], [(0, 3), (1, 4), (1, 2), (4, 0)])
    chains = all_of(graph)
    assert chains.node.tolist() == [2, 3]
    assert along(chains, 0).tolist() in ([3, 0, 4, 1, 2], [2, 1, 4, 0, 3])
    assert chains.ends.tolist() == [[along(chains, 0)[0], along(chains, 0)[-1]]]
    assert chains.length_m.tolist() == [5.0]


def test_ways_meet_at_a_junction_and_a_loop_comes_back_to_its_node():
    # From 0 to the junction 1, to 5 directly, and around a loop of 2, 3 and 4.
    graph = graph_of(
        [(-1, 0), (0, 0), (1, 0), (1, 1), (0, 1), (0, -1)], [(0, 1), (1, 2), (2, 3), (3, 4), (4, 1), (1, 5)]
    )
    chains = all_of(graph)
    assert chains.node.tolist() == [0, 1, 5]
    found = sorted(tuple(sorted(along(chains, i).tolist())) for i in range(len(chains.ends)))
    assert found == [(0, 1), (1, 1, 2, 3, 4), (1, 5)]
    loop = int(np.argmax(np.diff(chains.start)))
    assert along(chains, loop).tolist() in ([1, 2, 3, 4, 1], [1, 4, 3, 2, 1])
    assert chains.ends[loop].tolist() == [1, 1]


def test_a_circle_by_itself_begins_and_ends_at_its_widest_vertex():
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    places = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    clearance = np.full(12, 0.5)
    clearance[7] = 0.6
    graph = graph_of(places, [(i, (i + 1) % 12) for i in range(12)], clearance)
    chains = all_of(graph)
    assert chains.node.tolist() == [7]
    assert chains.ends.tolist() == [[7, 7]]
    assert sorted(along(chains, 0).tolist()) == sorted([*range(12), 7])
    assert chains.length_m[0] == pytest.approx(graph.edge_length_m.sum())


def test_vertices_that_do_not_count_leave_the_others_in_shorter_chains_or_alone():
    graph = graph_of([(0, 0), (1, 0), (2, 0), (3, 0), (4, 0)], [(0, 1), (1, 2), (2, 3), (3, 4)])
    chains = contract(graph, np.array([True, True, True, False, True]))
    assert chains.node.tolist() == [0, 2, 4]
    assert chains.length_m.tolist() == [2.0]


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.5, 1.0))
def test_every_edge_between_vertices_that_count_lies_on_one_chain_and_nothing_else_does(seed, share):
    rng = np.random.default_rng(seed)
    free = np.full((200, 200), FREE, np.int8)
    topdown = TopDownMap(free.astype(np.float32), free, 0.05, np.zeros(2), surface_xy_m=rng.uniform(1, 9, (80, 2)))
    graph = voronoi_graph(topdown, np.array([5.0, 5.0]), PlanningConfig(min_site_distance_m=1e-6), 0.3)
    kept = rng.random(len(graph.vertex_xy_m)) < share
    chains = contract(graph, kept)
    edges = np.sort(graph.edges[kept[graph.edges].all(axis=1)], axis=1)
    ways = [along(chains, i) for i in range(len(chains.ends))]
    walked = np.sort(np.concatenate([np.stack([a[:-1], a[1:]], axis=1) for a in ways]), axis=1)
    assert sorted(map(tuple, walked)) == sorted(map(tuple, edges))
    inner = np.concatenate([a[1:-1] for a in ways])
    assert sorted([*inner, *chains.node]) == np.flatnonzero(kept).tolist()
    lengths = [np.linalg.norm(np.diff(graph.vertex_xy_m[a], axis=0), axis=1).sum() for a in ways]
    assert np.allclose(chains.length_m, lengths)


def test_a_t_junction_is_one_node_of_three_chains():
    # Corridors of 1.2 m: one along x from 0.2 to 8.2, one from its middle up to y = 5.4.
    world = room(8, 5.2, boxes=[(0, 1.4, 3.6, 5.6), (4.8, 1.4, 8.4, 5.6)])
    chains, graph = contracted(world, 4.2, 0.8)
    assert len(chains.node) == 4
    assert len(chains.ends) == 3
    junction = np.bincount(chains.ends.ravel()).argmax()
    assert graph.vertex_xy_m[junction] == pytest.approx([4.2, 0.9], abs=0.15)
    assert (chains.ends == junction).any(axis=1).all()


def test_components_are_numbered_from_the_largest():
    closed = [(4.2, 0.2, 4.3, 1.45), (4.2, 1.8, 4.3, 3.2), (6.0, 0.2, 6.1, 3.2)]
    graph, _ = see(room(8, 3, boxes=closed), 2, 1.6)
    label = components(graph)
    middle = [label[np.argmin(np.linalg.norm(graph.vertex_xy_m - [x, 1.7], axis=1))] for x in (2.0, 5.2, 7.2)]
    assert len(set(middle)) == 3
    assert (np.diff(np.bincount(label)) <= 0).all()


def test_an_empty_graph_has_neither_nodes_nor_chains():
    graph = graph_of([], [])
    chains = all_of(graph)
    assert chains.node.tolist() == []
    assert chains.ends.shape == (0, 2)
    assert chains.start.tolist() == [0]
    assert components(graph).tolist() == []
