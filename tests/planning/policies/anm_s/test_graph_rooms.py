import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from anm_mj.geometry import room_merging
from anm_mj.geometry.room_merging import merge_into_rooms
from anm_mj.planning.policies.anm_s.graph_rooms import NARROWING, edge_bottlenecks, segment_rooms
from anm_mj.types import OCCUPIED, OccupancyGrid, VoronoiGraph
from tests.planning.worlds import RESOLUTION_M, room, see

DOOR = [(4.2, 0.2, 4.3, 1.2), (4.2, 2.1, 4.3, 3.2)]
TABLE = (1.6, 1.2, 3.0, 2.2)


def rooms_of(world, x=2.0, y=1.6):
    graph, topdown = see(world, x, y)
    return segment_rooms(graph, topdown, np.array([x, y])), graph


def num_rooms(world, x=2.0, y=1.6):
    return rooms_of(world, x, y)[0].max() + 1


def doors_of(room, graph):
    """The middles between the borders of the edges between rooms."""
    _, border_xy_m, _ = edge_bottlenecks(graph)
    return border_xy_m[room[graph.edges[:, 0]] != room[graph.edges[:, 1]]].mean(axis=1)


def row_of_rooms(num):
    """A corridor of 1.2 m along rooms of 4 m by 3 m, each with a door of 0.9 m to it, and the doors' places."""
    width = 4.1 * num - 0.1
    boxes, doors = [], []
    for k in range(num):
        x = 0.2 + 4.1 * k
        boxes += [(x, 1.4, x + 1.5, 1.5), (x + 2.4, 1.4, x + 4.1, 1.5), (x + 4.0, 1.5, x + 4.1, 4.5)]
        doors.append((x + 1.95, 1.45))
    return room(width, 4.3, boxes=boxes), np.array(doors)


class Turned:
    """A world turned by an angle about its middle, on a grid that holds all of it."""

    def __init__(self, world, angle_rad):
        plan = world.occupancy.state[0]
        side = math.ceil(math.hypot(*plan.shape)) + 2
        rows, cols = np.indices((side, side)) + 0.5 - side / 2
        c, s = math.cos(angle_rad), math.sin(angle_rad)
        there = np.stack([-s * cols + c * rows, c * cols + s * rows])
        middle = np.array(plan.shape)[:, None, None] / 2
        turned = ndimage.map_coordinates(plan, there + middle - 0.5, order=0, cval=OCCUPIED)
        state = np.repeat(turned[None], len(world.occupancy.state), axis=0)
        seen = np.where(state == OCCUPIED, np.float32(1.0), np.float32(np.inf))
        self.occupancy = OccupancyGrid(state, seen, np.zeros(3), RESOLUTION_M)
        self._turn = np.array([[c, -s], [s, c]])
        self._from = np.array(plan.shape[::-1]) * RESOLUTION_M / 2
        self._to = np.full(2, side * RESOLUTION_M / 2)

    def turn(self, xy_m):
        return (np.asarray(xy_m) - self._from) @ self._turn.T + self._to

    def sdf(self, points_m):
        col, row = np.floor(points_m[:, :2].T / RESOLUTION_M).astype(int)
        return np.where(self.occupancy.state[0, row, col] == OCCUPIED, -0.05, 0.1).astype(np.float32)


def test_two_rooms_meet_at_their_door():
    found, graph = rooms_of(room(8, 3, boxes=DOOR))
    assert doors_of(found, graph) == pytest.approx(np.array([[4.25, 1.65]]), abs=0.08)
    # Every vertex is in the room that it lies in; the door itself may be counted to either.
    x = graph.vertex_xy_m[:, 0]
    assert set(found[x < 4.1]) == {0}
    assert set(found[x > 4.4]) == {1}
    assert set(found) == {0, 1}


def test_nearest_room_to_the_start_is_the_first():
    found, graph = rooms_of(room(8, 3, boxes=DOOR), 6.0)
    assert graph.vertex_xy_m[found == 0, 0].min() > 4.1


def test_table_does_not_part_a_room():
    found, _ = rooms_of(room(4.4, 3, boxes=[TABLE]))
    assert set(found) == {0}


def test_corridor_with_four_rooms_makes_five():
    world, doors = row_of_rooms(4)
    found, graph = rooms_of(world, 1.0, 0.8)
    assert found.max() + 1 == 5
    assert len(doors_of(found, graph)) == 4
    assert np.linalg.norm(doors[:, None] - doors_of(found, graph)[None], axis=-1).min(axis=1).max() < 0.15
    assert set(found[graph.vertex_xy_m[:, 1] < 1.3]) == {0}


def test_wide_opening_is_no_door():
    opening = [(4.2, 0.2, 4.3, 0.7), (4.2, 2.7, 4.3, 3.2)]
    assert num_rooms(room(8, 3, boxes=opening)) == 1


def test_niche_belongs_to_its_room():
    niche = [
        (4.2, 0.2, 4.3, 1.2),
        (4.2, 2.1, 4.3, 3.2),
        (5.5, 0.2, 8.2, 3.2),
        (4.2, 0.2, 8.2, 1.0),
        (4.2, 2.3, 8.2, 3.2),
    ]
    assert num_rooms(room(8, 3, boxes=niche)) == 1


def test_small_disconnected_part_is_no_room():
    cell = [(5.0, 0.2, 5.1, 1.4), (5.0, 1.3, 6.3, 1.4), (6.2, 0.2, 6.3, 1.4)]
    found, graph = rooms_of(room(8, 3, boxes=cell))
    inside = (np.abs(graph.vertex_xy_m - [5.65, 0.75]) < 0.6).all(axis=1)
    assert inside.any()
    assert set(found[inside]) == {-1}
    assert set(found[~inside]) == {0}


def test_edge_of_the_view_is_no_door():
    # The unknown leaves as much as a door between itself and the wall, with wide places to both sides.
    unknown = [(4.0, 1.1, 4.6, 3.2)]
    assert num_rooms(room(8, 3, unknown=unknown)) == 1
    assert num_rooms(room(8, 3, boxes=unknown)) == 2


def test_free_standing_walls_part_rooms():
    # Two rooms with two doors: what is left of the wall between them touches nothing.
    wall = [(4.2, 0.2, 4.3, 0.7), (4.2, 1.6, 4.3, 3.6), (4.2, 4.5, 4.3, 5.2)]
    found, graph = rooms_of(room(8, 5, boxes=wall))
    assert found.max() + 1 == 2
    assert len(doors_of(found, graph)) == 2


@pytest.mark.parametrize("angle_deg", [0, 17, 45, 73])
def test_turning_the_plan_turns_the_rooms(angle_deg):
    world, doors = row_of_rooms(2)
    turned = Turned(world, math.radians(angle_deg))
    x, y = turned.turn((1.0, 0.8))
    found, graph = rooms_of(turned, float(x), float(y))
    assert found.max() + 1 == 3
    assert len(doors_of(found, graph)) == 2
    assert np.linalg.norm(turned.turn(doors)[:, None] - doors_of(found, graph)[None], axis=-1).min(axis=1).max() < 0.2


def test_cost_grows_linearly_with_the_rooms(monkeypatch):
    calls = []
    connected_components = room_merging.connected_components
    monkeypatch.setattr(room_merging, "connected_components", lambda *of: calls.append(1) or connected_components(*of))
    per_room, rounds = [], []
    for num in (4, 8, 16):
        world, _ = row_of_rooms(num)
        calls.clear()
        found, graph = rooms_of(world, 1.0, 0.8)
        assert found.max() + 1 == num + 1
        per_room.append(np.array([len(graph.vertex_xy_m), len(graph.edges)]) / num)
        rounds.append(len(calls))
    assert (per_room[1] <= per_room[0]).all()
    assert (per_room[2] <= per_room[1]).all()
    assert max(rounds) <= rounds[0] + 2


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([0.0, 3.0, 8.0]))
def test_merging_at_once_equals_merging_one_by_one(seed, least_m2):
    rng = np.random.default_rng(seed)
    num = 40
    edges = np.unique(np.sort(rng.integers(num, size=(70, 2)), axis=1), axis=0)
    edges = edges[edges[:, 0] != edges[:, 1]]
    clearance = rng.uniform(0.3, 2.0, num)
    width = clearance[edges].min(axis=1) * rng.uniform(0.5, 1.0, len(edges))
    floor = rng.uniform(0.0, 2.0, len(edges))
    part = merge_into_rooms(
        edges, width, np.ones(len(edges), bool), clearance, np.bincount(edges[:, 0], floor, num), NARROWING, least_m2
    )

    expected = np.arange(num)

    def flat(edge, side):
        return width[edge] > NARROWING * clearance[expected == side].max()

    def small(_, side):
        return floor[expected[edges[:, 0]] == side].sum() < least_m2

    for no_room in (flat, small):
        for edge in np.argsort(-width):
            a, b = expected[edges[edge]]
            if a != b and (no_room(edge, a) or no_room(edge, b)):
                expected[expected == b] = a
    assert (np.equal.outer(part, part) == np.equal.outer(expected, expected)).all()


def test_a_graph_without_vertices_has_no_rooms():
    nothing = VoronoiGraph(np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2), np.int64), np.zeros(0))
    found = segment_rooms(nothing, see(room(1, 1), 0.7, 0.7)[1], np.zeros(2))
    assert len(found) == 0
