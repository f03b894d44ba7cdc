import numpy as np

from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.policies.anm_s.region_finder import RegionFinder, line_of_sight
from anm_mj.types import SurfacePoints, VoronoiGraph
from tests.planning import worlds

CONFIG = PlanningConfig()

NONE = np.zeros(0, np.int64)
"""No vertex is preferred."""


def room(*size_m, **contents):
    """A room whose surface has been seen from afar only."""
    world = worlds.room(*size_m, **contents)
    world.occupancy.seen_range_m[:] = 6.0
    return world


def graph_at(*places):
    xy = np.array(places, float)
    return VoronoiGraph(xy, np.ones(len(xy)), np.zeros((0, 2), np.int64), np.zeros(0))


def wall_points(x, y0, y1, normal_x, uncertainty):
    y, z = np.meshgrid(np.arange(y0, y1, 0.1), np.arange(0.2, 1.4, 0.1))
    xyz = np.stack([np.full(y.size, x), y.ravel(), z.ravel()], axis=1).astype(np.float32)
    normal = np.tile(np.array([[normal_x, 0, 0]], np.float32), (y.size, 1))
    return xyz, normal, np.full(y.size, uncertainty, np.float32)


def surface_of(*parts):
    return SurfacePoints(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def finder_with(surface):
    finder = RegionFinder(CONFIG)
    finder.update(surface, np.array([4.0, 1.5]), 100.0)
    return finder


def test_uncertain_wall_is_one_region_at_the_vertex_that_sees_it():
    world = room(4, 3)
    surface = surface_of(wall_points(4.2, 1.0, 1.6, -1.0, 9.0), wall_points(0.2, 0.2, 3.2, 1.0, 1.0))
    graph = graph_at((2.5, 1.3), (1.0, 1.3))
    (region,) = finder_with(surface).regions(graph, world.occupancy, 1.25, NONE)
    assert region.vertex == 0
    assert np.allclose(region.centre_m[:2], [4.2, 1.25], atol=0.15)
    assert np.allclose(region.normal, [-1, 0, 0], atol=1e-6)
    assert region.score > 5.0


def test_two_sides_of_a_wall_are_two_regions():
    world = room(8, 3, boxes=[(4.2, 0.2, 4.3, 3.2)])
    surface = surface_of(
        wall_points(4.2, 1.0, 1.6, -1.0, 9.0), wall_points(4.3, 1.0, 1.6, 1.0, 9.0), wall_points(0.2, 0, 8, 1.0, 1.0)
    )
    graph = graph_at((3.0, 1.3), (5.5, 1.3))
    regions = finder_with(surface).regions(graph, world.occupancy, 1.25, NONE)
    assert sorted((region.vertex, round(region.normal[0])) for region in regions) == [(0, -1), (1, 1)]


def test_region_that_no_vertex_sees_is_left_out():
    world = room(8, 3, boxes=[(4.2, 0.2, 4.3, 3.2)])
    surface = surface_of(wall_points(4.3, 1.0, 1.6, 1.0, 9.0), wall_points(0.2, 0, 8, 1.0, 1.0))
    assert finder_with(surface).regions(graph_at((3.0, 1.3)), world.occupancy, 1.25, NONE) == ()


def test_observed_region_does_not_come_back():
    world = room(4, 3)
    finder = finder_with(surface_of(wall_points(4.2, 1.0, 1.6, -1.0, 9.0), wall_points(0.2, 0.2, 3.2, 1.0, 1.0)))
    graph = graph_at((2.5, 1.3))
    (region,) = finder.regions(graph, world.occupancy, 1.25, NONE)
    finder.mark_observed(region)
    assert finder.regions(graph, world.occupancy, 1.25, NONE) == ()


def test_surface_seen_from_near_is_no_region():
    world = room(4, 3)
    finder = finder_with(surface_of(wall_points(4.2, 1.0, 1.6, -1.0, 9.0), wall_points(0.2, 0.2, 3.2, 1.0, 1.0)))
    world.occupancy.seen_range_m[:] = CONFIG.anchor_range_m - 0.1
    assert finder.regions(graph_at((2.5, 1.3)), world.occupancy, 1.25, NONE) == ()


def test_long_wall_is_one_region_per_vertex():
    world = room(8, 3)
    wall = wall_points(0.2, 1.0, 7.0, 1.0, 9.0)
    along = (wall[0][:, [1, 0, 2]], wall[1][:, [1, 0, 2]], wall[2])
    plain = [wall_points(x, 0.2, 3.2, 1.0, 1.0) for x in np.arange(0.2, 0.7, 0.05)]
    finder = finder_with(surface_of(along, *plain))
    regions = finder.regions(graph_at((2.5, 1.5), (5.5, 1.5)), world.occupancy, 1.25, NONE)
    assert sorted(region.vertex for region in regions) == [0, 1]
    left, right = sorted(regions, key=lambda region: region.centre_m[0])
    assert left.vertex == 0
    assert left.centre_m[0] < 4.0 < right.centre_m[0]


def test_other_vertices_serve_for_what_preferred_ones_do_not_see():
    world = room(8, 3, boxes=[(4.2, 0.2, 4.3, 3.2)])
    surface = surface_of(
        wall_points(4.2, 1.0, 1.6, -1.0, 9.0), wall_points(4.3, 1.0, 1.6, 1.0, 9.0), wall_points(0.2, 0, 8, 1.0, 1.0)
    )
    graph = graph_at((2.0, 1.3), (3.5, 1.3), (5.5, 1.3))
    regions = finder_with(surface).regions(graph, world.occupancy, 1.25, np.array([0]))
    assert sorted((region.vertex, round(region.normal[0])) for region in regions) == [(0, -1), (2, 1)]


def test_surface_outside_of_an_update_is_remembered():
    world = room(4, 3)
    finder = finder_with(surface_of(wall_points(4.2, 1.0, 1.6, -1.0, 9.0), wall_points(0.2, 0.2, 3.2, 1.0, 1.0)))
    finder.update(surface_of(wall_points(0.2, 0.2, 3.2, 1.0, 1.0)), np.array([0.2, 1.7]), 2.0)
    assert len(finder.regions(graph_at((2.5, 1.3)), world.occupancy, 1.25, NONE)) == 1


def test_line_of_sight_ends_at_an_obstacle_and_passes_over_a_low_one():
    world = room(4, 3, boxes=[(2.0, 1.0, 2.1, 2.0)])
    eye, end = np.array([[1.0, 1.5, 1.25]] * 2), np.array([[3.5, 1.5, 1.25], [3.5, 2.9, 1.25]])
    assert line_of_sight(world.occupancy, eye, end).tolist() == [False, True]
    world.occupancy.state[10:, 20:40, 40:42] = 0
    assert line_of_sight(world.occupancy, eye, end).tolist() == [True, True]


def test_empty_map_has_no_regions():
    assert RegionFinder(CONFIG).regions(graph_at((1.0, 1.0)), room(4, 3).occupancy, 1.25, NONE) == ()


def test_surface_that_is_known_well_forms_no_region():
    world = room(4, 3)
    surface = surface_of(wall_points(4.2, 1.0, 1.6, -1.0, 9.0), wall_points(0.2, 0.2, 3.2, 1.0, 1.0))
    graph = graph_at((2.5, 1.3), (1.0, 1.3))
    # However near it was seen: the expected error says what is known.
    world.occupancy.seen_range_m[:] = 1.0
    for error_m, count in ((0.02, 1), (0.001, 0)):
        finder = RegionFinder(CONFIG)
        finder.update(surface, np.array([4.0, 1.5]), 100.0, np.full(len(surface.uncertainty), error_m, np.float32))
        assert len(finder.regions(graph, world.occupancy, 1.25, NONE)) == count
