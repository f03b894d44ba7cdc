import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anm_mj.planning.borders import borders_unknown
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.policies.anm_s.decision_vertices import contracted_edges, prune_spurs
from anm_mj.planning.voronoi_graph import voronoi_graph
from anm_mj.types import FREE, TopDownMap
from tests.planning.worlds import room, see


def contract(edges, num):
    """The contracted edges of a graph: its nodes, the contracted edge of each edge, and the nodes at its ends."""
    edges = np.array(edges, np.int64).reshape(-1, 2)
    node = np.bincount(edges.ravel(), minlength=num) != 2
    return np.flatnonzero(node).tolist(), *contracted_edges(edges, node)


def test_path_without_a_node_is_one_edge():
    # The vertices' numbers say nothing of their order along the way: 3, 0, 4, 1, 2.
    node, contracted, ends = contract([(0, 3), (1, 4), (1, 2), (4, 0)], 5)
    assert node == [2, 3]
    assert contracted.tolist() == [0, 0, 0, 0]
    assert np.sort(ends).tolist() == [[2, 3]]


def test_edges_meet_at_a_node_and_a_loop_returns_to_its_node():
    # From 0 to the junction 1, to 5 directly, and around a loop of 2, 3 and 4.
    node, contracted, ends = contract([(0, 1), (1, 2), (2, 3), (3, 4), (4, 1), (1, 5)], 6)
    assert node == [0, 1, 5]
    assert len(set(contracted[1:5])) == 1
    assert ends[contracted[1]].tolist() == [1, 1]
    assert sorted(ends[contracted[0]]) == [0, 1]
    assert sorted(ends[contracted[5]]) == [1, 5]


def test_a_circle_has_no_ends():
    node, contracted, ends = contract([(i, (i + 1) % 12) for i in range(12)], 12)
    assert node == []
    assert set(contracted) == {0}
    assert ends.tolist() == [[-1, -1]]


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.5, 1.0))
def test_contracted_edges_are_rows_of_edges_between_nodes(seed, share):
    rng = np.random.default_rng(seed)
    free = np.full((200, 200), FREE, np.int8)
    topdown = TopDownMap(
        np.full(free.shape, 5.0, np.float32), free, 0.05, np.zeros(2), surface_xy_m=rng.uniform(1, 9, (80, 2))
    )
    graph = voronoi_graph(topdown, np.array([5.0, 5.0]), PlanningConfig(min_site_distance_m=1e-6), 0.3)
    kept = rng.random(len(graph.vertex_xy_m)) < share
    edges = graph.edges[kept[graph.edges].all(axis=1)]
    node, contracted, ends = contract(edges, len(kept))
    assert set(contracted) == set(range(len(ends)))
    for k, (a, b) in enumerate(ends.tolist()):
        vertex, count = np.unique(edges[contracted == k], return_counts=True)
        assert set(vertex) & set(node) == {a, b} - {-1}
        # Each vertex between has its two edges here; each end has one, or two if both ends are the same.
        assert (count[~np.isin(vertex, node)] == 2).all()
        assert count[np.isin(vertex, node)].sum() == (0 if a < 0 else 2)


def test_t_junction_is_a_node_of_three_edges():
    # Corridors of 1.2 m: one along x from 0.2 to 8.2, one from its middle up to y = 5.4.
    world = room(8, 5.2, boxes=[(0, 1.4, 3.6, 5.6), (4.8, 1.4, 8.4, 5.6)])
    graph, topdown = see(world, 4.2, 0.8)
    kept = prune_spurs(graph, borders_unknown(graph, topdown.frontier_xy_m))
    _, _, ends = contract(graph.edges[kept[graph.edges].all(axis=1)], len(kept))
    assert len(set(ends.ravel())) == 4
    assert len(ends) == 3
    junction = np.bincount(ends.ravel()).argmax()
    assert graph.vertex_xy_m[junction] == pytest.approx([4.2, 0.9], abs=0.15)
    assert (ends == junction).any(axis=1).all()


def test_empty_graph():
    node, contracted, ends = contract([], 0)
    assert node == []
    assert contracted.shape == (0,)
    assert ends.shape == (0, 2)
