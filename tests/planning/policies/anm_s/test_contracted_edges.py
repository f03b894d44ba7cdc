import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.policies.anm_s.contracted_edges import components, contract
from anm_mj.planning.policies.anm_s.spurs import prune_spurs
from anm_mj.planning.policies.anm_s.traversable_frontier import borders_unknown
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


def along(contracted, edge):
    """The vertices of one edge from end to end."""
    return contracted.vertex[contracted.start[edge] : contracted.start[edge + 1]]


def contracted_graph_of(world, x, y):
    """The contracted graph of a world without its spurs, and the graph."""
    graph, topdown = see(world, x, y)
    return contract(graph, prune_spurs(graph, borders_unknown(graph, topdown.frontier_xy_m))), graph


def test_path_without_a_node_is_one_edge_with_its_vertices_in_order():
    # The vertices' numbers say nothing of their order along the way: 3, 0, 4, 1, 2.
    graph = graph_of([(1, 0), (3, 0), (3, 2), (0, 0), (2, 0)], [(0, 3), (1, 4), (1, 2), (4, 0)])
    contracted = all_of(graph)
    assert contracted.node.tolist() == [2, 3]
    assert along(contracted, 0).tolist() in ([3, 0, 4, 1, 2], [2, 1, 4, 0, 3])
    assert contracted.ends.tolist() == [[along(contracted, 0)[0], along(contracted, 0)[-1]]]
    assert contracted.length_m.tolist() == [5.0]


def test_edges_meet_at_a_node_and_a_loop_returns_to_its_node():
    # From 0 to the junction 1, to 5 directly, and around a loop of 2, 3 and 4.
    graph = graph_of(
        [(-1, 0), (0, 0), (1, 0), (1, 1), (0, 1), (0, -1)], [(0, 1), (1, 2), (2, 3), (3, 4), (4, 1), (1, 5)]
    )
    contracted = all_of(graph)
    assert contracted.node.tolist() == [0, 1, 5]
    found = sorted(tuple(sorted(along(contracted, i).tolist())) for i in range(len(contracted.ends)))
    assert found == [(0, 1), (1, 1, 2, 3, 4), (1, 5)]
    loop = int(np.argmax(np.diff(contracted.start)))
    assert along(contracted, loop).tolist() in ([1, 2, 3, 4, 1], [1, 4, 3, 2, 1])
    assert contracted.ends[loop].tolist() == [1, 1]


def test_circle_begins_and_ends_at_its_widest_vertex():
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    places = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    clearance = np.full(12, 0.5)
    clearance[7] = 0.6
    graph = graph_of(places, [(i, (i + 1) % 12) for i in range(12)], clearance)
    contracted = all_of(graph)
    assert contracted.node.tolist() == [7]
    assert contracted.ends.tolist() == [[7, 7]]
    assert sorted(along(contracted, 0).tolist()) == sorted([*range(12), 7])
    assert contracted.length_m[0] == pytest.approx(graph.edge_length_m.sum())


def test_left_out_vertices_shorten_edges():
    graph = graph_of([(0, 0), (1, 0), (2, 0), (3, 0), (4, 0)], [(0, 1), (1, 2), (2, 3), (3, 4)])
    contracted = contract(graph, np.array([True, True, True, False, True]))
    assert contracted.node.tolist() == [0, 2, 4]
    assert contracted.length_m.tolist() == [2.0]


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.5, 1.0))
def test_every_kept_edge_lies_on_one_contracted_edge(seed, share):
    rng = np.random.default_rng(seed)
    free = np.full((200, 200), FREE, np.int8)
    topdown = TopDownMap(
        np.full(free.shape, 5.0, np.float32), free, 0.05, np.zeros(2), surface_xy_m=rng.uniform(1, 9, (80, 2))
    )
    graph = voronoi_graph(topdown, np.array([5.0, 5.0]), PlanningConfig(min_site_distance_m=1e-6), 0.3)
    kept = rng.random(len(graph.vertex_xy_m)) < share
    contracted = contract(graph, kept)
    edges = np.sort(graph.edges[kept[graph.edges].all(axis=1)], axis=1)
    ways = [along(contracted, i) for i in range(len(contracted.ends))]
    walked = np.sort(np.concatenate([np.stack([a[:-1], a[1:]], axis=1) for a in ways]), axis=1)
    assert sorted(map(tuple, walked)) == sorted(map(tuple, edges))
    inner = np.concatenate([a[1:-1] for a in ways])
    assert sorted([*inner, *contracted.node]) == np.flatnonzero(kept).tolist()
    lengths = [np.linalg.norm(np.diff(graph.vertex_xy_m[a], axis=0), axis=1).sum() for a in ways]
    assert np.allclose(contracted.length_m, lengths)


def test_t_junction_is_a_node_of_three_edges():
    # Corridors of 1.2 m: one along x from 0.2 to 8.2, one from its middle up to y = 5.4.
    world = room(8, 5.2, boxes=[(0, 1.4, 3.6, 5.6), (4.8, 1.4, 8.4, 5.6)])
    contracted, graph = contracted_graph_of(world, 4.2, 0.8)
    assert len(contracted.node) == 4
    assert len(contracted.ends) == 3
    junction = np.bincount(contracted.ends.ravel()).argmax()
    assert graph.vertex_xy_m[junction] == pytest.approx([4.2, 0.9], abs=0.15)
    assert (contracted.ends == junction).any(axis=1).all()


def test_components_are_numbered_from_the_largest():
    closed = [(4.2, 0.2, 4.3, 1.45), (4.2, 1.8, 4.3, 3.2), (6.0, 0.2, 6.1, 3.2)]
    graph, _ = see(room(8, 3, boxes=closed), 2, 1.6)
    label = components(graph)
    middle = [label[np.argmin(np.linalg.norm(graph.vertex_xy_m - [x, 1.7], axis=1))] for x in (2.0, 5.2, 7.2)]
    assert len(set(middle)) == 3
    assert (np.diff(np.bincount(label)) <= 0).all()


def test_empty_graph():
    graph = graph_of([], [])
    contracted = all_of(graph)
    assert contracted.node.tolist() == []
    assert contracted.ends.shape == (0, 2)
    assert contracted.start.tolist() == [0]
    assert components(graph).tolist() == []
