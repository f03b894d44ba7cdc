"""No path of the graph leads through a wall, whatever its distance, angle and thickness, and each leads past it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from anm_mj.planning.paths import clearance_at, shortest_paths
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.topdown_mapper import TopDownMapper
from anm_mj.planning.voronoi_graph import clear_edges, voronoi_graph
from anm_mj.types import FREE, OCCUPIED, Footprint, OccupancyGrid, Pose2, TopDownMap
from tests.planning.worlds import topdown_map

CELL_M = 0.05
FOOTPRINT = Footprint(0.18, 0.05, 0.25)
CONFIG = PlanningConfig()
SAFE_M = FOOTPRINT.radius_m + CONFIG.margin_m
POSE = Pose2(1.2, 3.0, 0.0)


distances_m = st.floats(1.0, 24.0)
angles = st.floats(-0.6, 0.6)
thicknesses_m = st.floats(0.0, 0.5)


def hall_with_wall(distance_m, angle_rad, thickness_m, door_m=0.0, width_m=6.0):
    """A closed hall of 30 m with a wall across and a door in it, and how far each cell lies beyond the wall.

    The wall is at least as thick as a cell: thinner ones fill a cell, too.
    """
    length_m = 30.0
    # As far from the robot at its nearer end.
    x_m = min(POSE.x_m + distance_m + width_m / 2.0 * abs(math.tan(angle_rad)), length_m - 3.0)
    shape = round(width_m / CELL_M), round(length_m / CELL_M)
    y, x = (np.indices(shape) + 0.5) * CELL_M
    along, beside = x - x_m, y - width_m / 2.0
    beyond = along * math.cos(angle_rad) + beside * math.sin(angle_rad)
    across = np.abs(-along * math.sin(angle_rad) + beside * math.cos(angle_rad))
    # A line of cells that no step to one of four neighbours passes.
    half = max(thickness_m / 2.0, CELL_M / 2.0 * (abs(math.cos(angle_rad)) + abs(math.sin(angle_rad))))
    wall = (np.abs(beyond) <= half) & (across >= door_m / 2.0)
    wall |= (x < 0.2) | (x > length_m - 0.2) | (y < 0.2) | (y > width_m - 0.2)
    state = np.where(wall, np.int8(OCCUPIED), np.int8(FREE))[None].repeat(6, axis=0)
    grid = OccupancyGrid(state, np.where(state == OCCUPIED, np.float32(1), np.float32(np.inf)), np.zeros(3), CELL_M)
    return grid, beyond - half


def reached(grid, *, coarse_far_field):
    """Vertices of the graph that a path leads to [m], and all of them."""

    def sdf(points_m):
        return np.full(len(points_m), 0.1, np.float32)

    topdown = topdown_map(TopDownMapper(CONFIG, FOOTPRINT), grid, sdf, POSE)
    graph = voronoi_graph(topdown, POSE.xy_m, CONFIG, SAFE_M, coarse_far_field=coarse_far_field)
    distance_m = shortest_paths(graph, topdown, POSE, SAFE_M).distance_m
    return graph.vertex_xy_m[np.isfinite(distance_m)], graph.vertex_xy_m


def is_beyond(beyond_m, xy_m):
    col, row = (xy_m / CELL_M).astype(int).T
    return beyond_m[row, col] > 0.0


@pytest.mark.parametrize("coarse_far_field", [False, True])
def test_a_wall_far_down_a_hall_closes_it(coarse_far_field: bool):
    grid, beyond_m = hall_with_wall(19.0, 0.0, 0.15, width_m=12.0)
    found, vertices = reached(grid, coarse_far_field=coarse_far_field)
    assert is_beyond(beyond_m, vertices).sum() > 20
    assert len(found) > 20
    assert not is_beyond(beyond_m, found).any()


@settings(max_examples=30, deadline=None)
@given(distances_m, angles, thicknesses_m, st.booleans())
def test_no_edge_leads_through_a_wall(distance_m, angle, thickness_m, coarse_far_field):
    grid, beyond_m = hall_with_wall(distance_m, angle, thickness_m)
    found, _ = reached(grid, coarse_far_field=coarse_far_field)
    assert len(found) > 0
    assert not is_beyond(beyond_m, found).any()


@settings(max_examples=20, deadline=None)
@given(distances_m, angles, thicknesses_m, st.floats(0.8, 1.5), st.booleans())
def test_a_door_in_a_wall_leads_through(distance_m, angle, thickness_m, door_m, coarse_far_field):
    grid, beyond_m = hall_with_wall(distance_m, angle, thickness_m, door_m)
    found, _ = reached(grid, coarse_far_field=coarse_far_field)
    assert is_beyond(beyond_m, found).any()


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.05, 0.3))
def test_bisection_finds_what_many_samples_find(seed, least_m):
    rng = np.random.default_rng(seed)
    free = rng.random((60, 60)) > 0.02
    # The rim of the map is a border, as in the real one.
    free[[0, -1]] = free[:, [0, -1]] = False
    clearance = (np.asarray(ndimage.distance_transform_edt(free)) - 0.5).astype(np.float32) * np.float32(CELL_M)
    topdown = TopDownMap(clearance, np.where(free, FREE, OCCUPIED).astype(np.int8), CELL_M, np.zeros(2))
    start, end = rng.uniform(-0.1, 3.1, (2, 100, 2))
    clear = clear_edges(topdown, start, end, least_m)
    share = np.linspace(0.0, 1.0, 400)
    xy = start[:, None] + share[:, None] * (end - start)[:, None]
    at = np.stack([clearance_at(topdown, edge).min() for edge in xy])
    # Between two samples, half a cell apart, an edge may cut the corner of a cell.
    assert not clear[at < least_m - 1.5 * CELL_M].any()
    assert clear[at >= least_m + 1.5 * CELL_M].all()
    assert clear.any() or least_m > 0.1
