import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anm_mj.planning.paths import ShortestPathTree, shortest_paths
from anm_mj.planning.policies.gvg.travel_costs import TravelCosts
from anm_mj.planning.policies.gvg.views import HALF_TURN, NUM_AZIMUTHS
from anm_mj.types import FORWARD_STEP_M, Pose2, TopDownMap, VoronoiGraph
from tests.planning.worlds import room, see

EAST, NORTH = 0, 9
DOOR_XY_M = np.array([4.25, 1.65])


@pytest.fixture(scope="module")
def two_rooms():
    """Shortest paths in two rooms of 4 m by 3 m with a door between them, for a robot in the first."""
    graph, topdown = see(room(8, 3, boxes=[(4.2, 0.2, 4.3, 1.2), (4.2, 2.1, 4.3, 3.2)]), 1.0, 1.7)
    return shortest_paths(graph, topdown, Pose2(1.0, 1.7, 0.0), 0.22)


def between(costs, two_rooms, vertex):
    xy_m = np.concatenate([two_rooms.pose.xy_m[None], two_rooms.graph.vertex_xy_m[vertex]])
    return costs.between(xy_m, np.concatenate([[-1], vertex]))


def nearest(two_rooms, *places):
    away = np.linalg.norm(two_rooms.graph.vertex_xy_m[:, None] - np.array(places), axis=-1)
    return away.argmin(axis=0)


def test_costs_do_not_depend_on_what_was_asked_before(two_rooms):
    reached = np.flatnonzero(np.isfinite(two_rooms.distance_m))
    costs = TravelCosts(two_rooms)
    # Some vertices are on both.
    for some in (reached[::25], reached[::-15]):
        for found, alone in zip(
            between(costs, two_rooms, some), between(TravelCosts(two_rooms), two_rooms, some), strict=True
        ):
            assert np.array_equal(found, alone)


def test_visible_places_are_connected_straight(two_rooms):
    topdown, pose = two_rooms.topdown, two_rooms.pose
    xy_m = np.array([pose.xy_m, [2.5, 1.7], [2.5, 2.6]])
    steps, leave, arrive = TravelCosts(
        ShortestPathTree(np.zeros(0), [-1], {}, graph_of(0), topdown, 0.22, pose)
    ).between(xy_m, np.full(3, -1))
    assert steps[0, 1] == pytest.approx(1.5 / FORWARD_STEP_M)
    assert steps[1, 2] == pytest.approx(0.9 / FORWARD_STEP_M)
    assert (leave[0, 1], arrive[0, 1], leave[1, 2], arrive[1, 2]) == (EAST, EAST, NORTH, NORTH)


def test_path_around_a_wall_leads_through_the_door(two_rooms):
    vertex = nearest(two_rooms, (3.4, 1.0), (5.1, 1.0))
    a, b = two_rooms.graph.vertex_xy_m[vertex]
    steps = between(TravelCosts(two_rooms), two_rooms, vertex)[0][1, 2]
    through_door = (math.dist(a, DOOR_XY_M) + math.dist(DOOR_XY_M, b)) / FORWARD_STEP_M
    assert math.dist(a, b) / FORWARD_STEP_M + 4 < through_door - 1 < steps


def test_path_back_is_as_long_and_leaves_where_the_other_arrives(two_rooms):
    vertex = nearest(two_rooms, (0.8, 0.8), (3.4, 1.0), (5.1, 1.0), (7.5, 2.6), (6.0, 1.7))
    steps, leave, arrive = between(TravelCosts(two_rooms), two_rooms, vertex)
    assert np.allclose(steps, steps.T)
    assert np.array_equal(leave, (arrive.T + HALF_TURN) % NUM_AZIMUTHS)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**31), st.integers(1, 40))
def test_path_along_the_tree_leads_over_the_last_shared_vertex(seed, num):
    rng = np.random.default_rng(seed)
    order = rng.permutation(num)
    predecessor, distance_m = [-1] * (num + 1), np.zeros(num + 1)
    for i, vertex in enumerate(order):
        # The robot itself is the node after all vertices.
        predecessor[vertex] = int(rng.choice([num, *order[:i]]))
        distance_m[vertex] = distance_m[predecessor[vertex]] + rng.uniform(0.1, 2.0)
    # All vertices in one place that no straight path leads to or from: turns are the same for all pairs.
    topdown = TopDownMap(np.full((1, 1), -1.0, np.float32), np.zeros((1, 1), np.int8), 0.05, np.zeros(2))
    graph = VoronoiGraph(np.full((num, 2), 0.5), np.ones(num), np.zeros((0, 2), np.int64), np.zeros(0))
    tree = ShortestPathTree(distance_m[:num], predecessor, {}, graph, topdown, 0.22, Pose2(0.0, 0.0, 0.0))
    vertex = rng.integers(num, size=12)

    steps = between(TravelCosts(tree), tree, vertex)[0][1:, 1:]

    paths = [tree.vertices_to(int(v)) for v in vertex]
    for i, one in enumerate(paths):
        for j, other in enumerate(paths):
            shared = max((distance_m[v] for v in one if v in other), default=0.0)
            expected = distance_m[vertex[i]] + distance_m[vertex[j]] - 2.0 * shared
            assert steps[i, j] == pytest.approx(expected / FORWARD_STEP_M + HALF_TURN, abs=1e-2)


def graph_of(num):
    return VoronoiGraph(np.zeros((num, 2)), np.ones(num), np.zeros((0, 2), np.int64), np.zeros(0))
