import numpy as np
import pytest

from anm_mj.planning.borders import borders_unknown, traversable_frontier
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.policies.anm_s.decision_vertices import SPACING_M, decision_vertices, prune_spurs
from anm_mj.planning.topdown_mapper import TopDownMapper
from anm_mj.planning.voronoi_graph import voronoi_graph
from anm_mj.types import Footprint, Pose2, VoronoiGraph
from tests.planning.worlds import room, topdown_map

NOWHERE = np.zeros((0, 2))


def graph_of(places, edges, clearance):
    xy = np.array(places, float)
    edges = np.array(edges, np.int64).reshape(-1, 2)
    length = np.linalg.norm(xy[edges[:, 0]] - xy[edges[:, 1]], axis=1)
    return VoronoiGraph(xy, np.array(clearance, float), edges, length)


def decide(graph, frontier):
    return decision_vertices(graph, prune_spurs(graph, borders_unknown(graph, frontier)))


def corridor_with_a_spur(spur_clearance):
    """A way of 3 m of even clearance from vertex 0 to 3, and a branch of 0.5 m from its vertex 1 to vertex 4."""
    places = [(0, 0), (1, 0), (2, 0), (3, 0), (1, 0.5)]
    return graph_of(places, [(0, 1), (1, 2), (2, 3), (1, 4)], [0.6, 0.6, 0.6, 0.6, spur_clearance])


def test_spur_is_pruned_and_branch_of_even_clearance_is_kept():
    kept = prune_spurs(corridor_with_a_spur(0.2), np.zeros(5, bool))
    assert kept.tolist() == [True, True, True, True, False]
    assert prune_spurs(corridor_with_a_spur(0.5), np.zeros(5, bool)).all()


def test_branch_at_the_unknown_is_kept():
    graph = corridor_with_a_spur(0.2)
    frontier = np.array([[1.0, 0.8]])
    assert borders_unknown(graph, frontier).tolist() == [False, False, False, False, True]
    assert 4 in decide(graph, frontier)
    assert 4 not in decide(graph, NOWHERE)


def test_nodes_are_decision_vertices():
    assert decide(corridor_with_a_spur(0.5), NOWHERE).tolist() == [0, 1, 3, 4]


@pytest.mark.parametrize(("away_m", "chosen"), [(1.2, [4, 6]), (3.0, [0, 4, 6])])
def test_node_of_spurs_counts_only_far_from_others(away_m, chosen):
    # Three spurs about vertex 0, and a way of 2 m past it from vertex 4 to 6.
    star = [(1, away_m), (1, away_m + 0.5), (0.6, away_m - 0.3), (1.4, away_m - 0.3)]
    edges = [(0, 1), (0, 2), (0, 3), (4, 5), (5, 6)]
    graph = graph_of([*star, (0, 0), (1, 0), (2, 0)], edges, [0.6, 0.2, 0.2, 0.2, 0.6, 0.6, 0.6])
    assert decide(graph, NOWHERE).tolist() == chosen


@pytest.mark.parametrize("closed", [False, True])
def test_long_paths_and_circles_have_decision_vertices_near_every_place(closed):
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    places = 4 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    edges = [(i, (i + 1) % 60) for i in range(60 if closed else 59)]
    graph = graph_of(places, edges, np.ones(60))
    chosen = places[decide(graph, NOWHERE)]
    away = np.linalg.norm(places[:, None] - chosen[None], axis=-1).min(axis=1)
    assert away.max() < SPACING_M
    assert len(chosen) < 20


def test_a_circle_has_a_decision_vertex_at_its_widest_place():
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    clearance = np.full(12, 0.5)
    clearance[7] = 0.6
    places = 0.5 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    graph = graph_of(places, [(i, (i + 1) % 12) for i in range(12)], clearance)
    assert decide(graph, NOWHERE).tolist() == [7]


def test_corners_of_a_bare_room_have_no_decision_vertices():
    world = room(6, 3)
    mapper = TopDownMapper(PlanningConfig(), Footprint(0.18, 0.05, 1.35))
    topdown = topdown_map(mapper, world.occupancy, world.sdf, Pose2(3.2, 1.7, 0.0))
    graph = voronoi_graph(topdown, np.array([3.2, 1.7]), PlanningConfig(), 0.22)
    chosen = graph.vertex_xy_m[decide(graph, topdown.frontier_xy_m)]
    corners = np.array([[0.2, 0.2], [6.2, 0.2], [0.2, 3.2], [6.2, 3.2]])
    assert 1 <= len(chosen) <= 6
    assert np.linalg.norm(chosen[:, None] - corners[None], axis=-1).min() > 1.0


def test_frontier_is_traversable_where_a_disc_fits():
    world = room(6, 3, unknown=[(2.0, 0.2, 4.0, 0.4), (5.2, 0.2, 6.2, 3.2)])
    mapper = TopDownMapper(PlanningConfig(), Footprint(0.18, 0.05, 1.35))
    topdown = topdown_map(mapper, world.occupancy, world.sdf, Pose2(1.2, 1.7, 0.0))
    assert (topdown.frontier_xy_m[:, 0] < 4.5).any()
    traversable = traversable_frontier(topdown, 0.22)
    assert len(traversable) > 40
    assert (traversable[:, 0] > 5.0).all()


def test_empty_graph_has_no_decision_vertices():
    graph = graph_of(np.zeros((0, 2)), [], [])
    assert decide(graph, np.ones((3, 2))).tolist() == []
