import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anm_mj.geometry.connected_components import connected_components
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.topdown_mapper import TopDownMapper
from anm_mj.planning.voronoi_graph import voronoi_graph
from anm_mj.types import FREE, Footprint, Pose2, TopDownMap
from tests.planning.worlds import BoxWorld, room, see, topdown_map

SAFE_M = 0.22
CONFIG = PlanningConfig(horizon_m=20.0)


def components(graph):
    """The connected component of each vertex, the largest first."""
    label = connected_components(graph.edges, len(graph.vertex_xy_m))
    return np.argsort(np.argsort(-np.bincount(label), kind="stable"))[label]


def border_map(border_xy_m, size=200):
    """A map that is free everywhere, with a given border: what the graph sees of the world and nothing else."""
    free = np.full((size, size), FREE, np.int8)
    return TopDownMap(np.full(free.shape, 5.0, np.float32), free, 0.05, np.zeros(2), surface_xy_m=border_xy_m)


def test_corridor_gives_its_centre_line():
    graph, _ = see(room(8, 1.2), 4, 0.8)
    inner = graph.vertex_xy_m[np.abs(graph.vertex_xy_m[:, 0] - 4.2) < 2.5]
    assert len(inner) > 10
    assert np.abs(inner[:, 1] - 0.8).max() < 0.03
    assert np.abs(graph.clearance_m[np.abs(graph.vertex_xy_m[:, 0] - 4.2) < 2.5] - 0.6).max() < 0.04


def test_t_junction_has_one_vertex_of_degree_three():
    # Corridors of 1.2 m: one along x from 0.2 to 8.2, one from its middle up to y = 5.4.
    world = BoxWorld(
        (8.4, 5.6),
        [(0, 0, 8.4, 0.2), (0, 0, 0.2, 5.6), (8.2, 0, 8.4, 5.6), (0, 1.4, 3.6, 5.6), (4.8, 1.4, 8.4, 5.6),
         (3.6, 5.4, 4.8, 5.6)],
    )  # fmt: skip
    graph, _ = see(world, 4.2, 0.8)
    forks = graph.vertex_xy_m[np.bincount(graph.edges.ravel()) >= 3]
    near = forks[np.linalg.norm(forks - [4.2, 0.9], axis=1) < 0.6]
    assert len(near) == 1


def test_door_connects_two_rooms_and_is_their_bottleneck():
    wall = [(4.2, 0.2, 4.3, 1.2), (4.2, 2.1, 4.3, 3.2)]
    graph, _ = see(room(8, 3, boxes=wall), 2, 1.6)
    label = components(graph)
    left, right = (label[np.argmin(np.linalg.norm(graph.vertex_xy_m - [x, 1.7], axis=1))] for x in (2.0, 6.5))
    assert left == right == 0
    a, b = graph.vertex_xy_m[graph.edges[:, 0]], graph.vertex_xy_m[graph.edges[:, 1]]
    through = (a[:, 0] < 4.25) != (b[:, 0] < 4.25)
    share = (4.25 - a[through, 0]) / (b[through, 0] - a[through, 0])
    y = a[through, 1] + share * (b[through, 1] - a[through, 1])
    assert y == pytest.approx(1.65, abs=0.05)


def test_narrow_door_separates_rooms():
    wall = [(4.2, 0.2, 4.3, 1.45), (4.2, 1.8, 4.3, 3.2)]
    graph, _ = see(room(8, 3, boxes=wall), 2, 1.6)
    label = components(graph)
    left, right = (label[np.argmin(np.linalg.norm(graph.vertex_xy_m - [x, 1.7], axis=1))] for x in (2.0, 6.5))
    assert left != right


def test_no_edge_passes_a_thin_leg_too_closely():
    leg = (2.00, 1.50, 2.05, 1.55)
    graph, _ = see(room(4, 3, boxes=[leg]), 1, 1)
    a, b = graph.vertex_xy_m[graph.edges[:, 0]], graph.vertex_xy_m[graph.edges[:, 1]]
    for share in np.linspace(0, 1, 9):
        point = a + share * (b - a)
        away = np.linalg.norm(np.maximum(np.abs(point - [2.025, 1.525]) - 0.025, 0), axis=1)
        assert away.min() > SAFE_M - 0.03


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31))
def test_vertices_are_equidistant_to_their_two_nearest_border_points(seed):
    border = np.random.default_rng(seed).uniform(1, 9, (60, 2))
    topdown = border_map(border)
    config = PlanningConfig(fine_spacing_m=1e-3, coarse_spacing_m=1e-3, min_site_distance_m=1e-6)
    graph = voronoi_graph(topdown, np.array([5.0, 5.0]), config, SAFE_M)
    distance = np.sort(np.linalg.norm(graph.vertex_xy_m[:, None] - border[None], axis=-1), axis=1)
    assert np.allclose(distance[:, 0], distance[:, 1], atol=1e-9)
    assert np.allclose(distance[:, 0], graph.clearance_m, atol=1e-9)
    assert (graph.clearance_m >= SAFE_M - 1e-9).all()


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.floats(0, 6.28))
def test_turning_the_border_turns_the_graph(seed, angle):
    # The ring bounds every cell inside it, so that no vertex depends on the map's rim, which does not turn.
    around = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    ring = 4.0 * np.stack([np.cos(around), np.sin(around)], axis=1)
    border = np.concatenate([np.random.default_rng(seed).uniform(-2.5, 2.5, (40, 2)), ring])
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    config = PlanningConfig(fine_spacing_m=1e-4, coarse_spacing_m=1e-4, min_site_distance_m=1e-6)
    centre = np.array([5.0, 5.0])
    graph = voronoi_graph(border_map(border + centre), centre, config, SAFE_M)
    turned = voronoi_graph(border_map(border @ rotation.T + centre), centre, config, SAFE_M)
    # An edge or vertex whose clearance is the limit itself may fall to either side of it.
    inside = (np.linalg.norm(graph.vertex_xy_m - centre, axis=1) < 3.5) & (graph.clearance_m > SAFE_M + 1e-6)
    expected = (graph.vertex_xy_m[inside] - centre) @ rotation.T + centre
    nearest = np.linalg.norm(turned.vertex_xy_m[None] - expected[:, None], axis=-1).min(axis=1)
    assert nearest.max(initial=0.0) < 1e-6


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31))
def test_every_place_is_retracted_onto_the_graph(seed):
    # Straight away from the nearest border point, the clearance grows until another one is as near: that is the graph.
    rng = np.random.default_rng(seed)
    around = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    border = 5.0 + np.concatenate(
        [rng.uniform(-2.5, 2.5, (40, 2)), 4.0 * np.stack([np.cos(around), np.sin(around)], 1)]
    )
    config = PlanningConfig(fine_spacing_m=1e-4, coarse_spacing_m=1e-4, min_site_distance_m=1e-6)
    graph = voronoi_graph(border_map(border), np.array([5.0, 5.0]), config, 1e-3)
    a, b = graph.vertex_xy_m[graph.edges[:, 0]], graph.vertex_xy_m[graph.edges[:, 1]]
    for place in 5.0 + rng.uniform(-2.0, 2.0, (20, 2)):
        from_border = place - border
        nearest = np.argmin(np.linalg.norm(from_border, axis=1))
        ahead = from_border[nearest] / np.linalg.norm(from_border[nearest])
        # At border + t * ahead the other point p is as near when |border + t * ahead - p| = t.
        apart = border[nearest] - border
        along = -2.0 * apart @ ahead
        others = (along > 1e-9) & (np.arange(len(border)) != nearest)
        retracted = border[nearest] + ((apart[others] ** 2).sum(axis=1) / along[others]).min() * ahead
        share = np.clip(((retracted - a) * (b - a)).sum(axis=1) / ((b - a) ** 2).sum(axis=1).clip(1e-18), 0.0, 1.0)
        assert np.linalg.norm(a + share[:, None] * (b - a) - retracted, axis=1).min() < 1e-6


def test_size_grows_linearly_with_the_border():
    rng = np.random.default_rng(1)
    config = PlanningConfig(fine_spacing_m=1e-3, coarse_spacing_m=1e-3, min_site_distance_m=1e-6)
    for count in (100, 400, 1600):
        graph = voronoi_graph(border_map(rng.uniform(1, 9, (count, 2))), np.array([5.0, 5.0]), config, 1e-3)
        assert len(graph.vertex_xy_m) <= 2 * count
        assert len(graph.edges) <= 3 * count


@pytest.mark.parametrize("border", [np.zeros((0, 2)), np.array([[1.0, 1], [2, 1], [3, 1], [4, 1], [5, 1]])])
def test_border_without_a_vertex_gives_an_empty_graph(border):
    graph = voronoi_graph(border_map(border), np.array([5.0, 5.0]), PlanningConfig(), SAFE_M)
    assert len(graph.vertex_xy_m) == 0
    assert graph.edges.shape == (0, 2)


def test_coarse_far_field_keeps_the_graph_connected():
    walls = [(x, 0.2, x + 0.1, 2.2) for x in (6.0, 12.0, 18.0, 24.0)]
    world = room(30, 4, boxes=walls)
    topdown = topdown_map(
        TopDownMapper(CONFIG, Footprint(0.18, 0.05, 1.35)), world.occupancy, world.sdf, Pose2(1, 1, 0)
    )
    config = PlanningConfig()
    fine, rough = (voronoi_graph(topdown, np.ones(2), config, SAFE_M, coarse_far_field=thin) for thin in (False, True))
    assert len(rough.vertex_xy_m) < 0.8 * len(fine.vertex_xy_m)
    main = rough.vertex_xy_m[components(rough) == 0]
    assert main[:, 0].min() < 2.0
    assert main[:, 0].max() > 28.0
