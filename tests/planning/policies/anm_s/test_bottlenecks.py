import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.policies.anm_s.graph_rooms import edge_bottlenecks
from anm_mj.planning.voronoi_graph import voronoi_graph
from anm_mj.types import FREE, TopDownMap, VoronoiGraph

EVERY_POINT = PlanningConfig(fine_spacing_m=1e-3, coarse_spacing_m=1e-3, min_site_distance_m=1e-6)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31))
def test_bottleneck_is_the_place_nearest_to_the_border(seed):
    border = np.random.default_rng(seed).uniform(1, 9, (60, 2))
    free = np.full((200, 200), FREE, np.int8)
    topdown = TopDownMap(np.full(free.shape, 5.0, np.float32), free, 0.05, np.zeros(2), surface_xy_m=border)
    graph = voronoi_graph(topdown, np.array([5.0, 5.0]), EVERY_POINT, 0.1)
    clearance_m, border_xy_m, _ = edge_bottlenecks(graph)

    def clearance(xy):
        return np.linalg.norm(xy[:, None] - border[None], axis=-1).min(axis=1)

    a, b = graph.vertex_xy_m[graph.edges[:, 0]], graph.vertex_xy_m[graph.edges[:, 1]]
    for share in np.linspace(0, 1, 7):
        assert (clearance(a + share * (b - a)) >= clearance_m - 1e-7).all()
    # Of an edge much shorter than its clearance, rounding hides the direction.
    long = graph.edge_length_m > 1e-3
    assert np.allclose(clearance(border_xy_m[long].reshape(-1, 2)), 0.0, atol=1e-6)


def test_edge_between_straight_walls_is_the_middle_of_its_floor():
    clearance_m, border_xy_m, floor_m2 = edge_bottlenecks(
        corridor_edge(0.2, math.hypot(0.1, 0.6), math.hypot(0.1, 0.6))
    )
    assert clearance_m.tolist() == pytest.approx([0.6])
    assert floor_m2.tolist() == pytest.approx([0.2 * 1.2])
    # To the left of the way first.
    assert border_xy_m[0] == pytest.approx(np.array([[0.1, 0.6], [0.1, -0.6]]))


def test_widening_edge_is_narrowest_at_its_end():
    clearance_m, border_xy_m, _ = edge_bottlenecks(corridor_edge(0.2, math.hypot(0.1, 0.6), math.hypot(0.3, 0.6)))
    assert clearance_m.tolist() == pytest.approx([math.hypot(0.1, 0.6)])
    assert border_xy_m[0] == pytest.approx(np.array([[-0.1, 0.6], [-0.1, -0.6]]))


def test_edge_without_length_is_as_wide_as_its_ends():
    graph = VoronoiGraph(np.ones((2, 2)), np.array([0.6, 0.6]), np.array([[0, 1]]), np.zeros(1))
    assert edge_bottlenecks(graph)[0].tolist() == [0.6]


def corridor_edge(length_m, start_m, end_m):
    """One edge along x from the origin, with the clearances at its ends."""
    xy = np.array([[0.0, 0.0], [length_m, 0.0]])
    return VoronoiGraph(xy, np.array([start_m, end_m]), np.array([[0, 1]]), np.array([length_m]))
