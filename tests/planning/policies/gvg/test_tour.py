import math

import numpy as np
import pytest

from anm_mj.planning.config import PlanningConfig
from anm_mj.planning.paths import shortest_paths
from anm_mj.planning.policies.gvg.tour import Places, TourSearch
from anm_mj.planning.policies.gvg.travel_costs import NUM_AZIMUTHS, TravelCosts
from anm_mj.planning.topdown import TopDownMapper
from anm_mj.planning.voronoi_graph import voronoi_graph
from anm_mj.types import FORWARD_STEP_M, Footprint, Pose2
from tests.planning.worlds import room

EAST, NORTH, WEST, SOUTH = 0, 9, 18, 27
CONFIG = PlanningConfig(horizon_m=20.0)


@pytest.fixture(scope="module")
def ways():
    """Shortest paths in an empty hall of 12 m by 6 m, for a robot in its middle."""
    world, pose = room(12, 6), Pose2(6.2, 3.2, 0.0)
    topdown = TopDownMapper(CONFIG, Footprint(0.18, 0.05, 1.35)).update(world.occupancy, world.sdf, pose)
    return shortest_paths(voronoi_graph(topdown, pose.xy_m, CONFIG, 0.22), topdown, pose, 0.22)


def search(ways, targets, patches=None, preferred=None, discount=100.0):
    """A search among the robot's place and others: for each x, y and {azimuth: gain}."""
    xy, worth = [ways.pose.xy_m], np.zeros((len(targets) + 1, NUM_AZIMUTHS), np.float32)
    vertex = [-1]
    patch = np.arange(worth.size).reshape(worth.shape)
    for i, (x, y, gains) in enumerate(targets, 1):
        v = int(np.argmin(np.linalg.norm(ways.graph.vertex_xy_m - [x, y], axis=1)))
        vertex.append(v)
        xy.append(ways.graph.vertex_xy_m[v])
        for azimuth, gain in gains.items():
            worth[i, azimuth] = gain
            if patches:
                patch[i, azimuth] = patches[i - 1]
    places = Places(np.array(xy), np.array(vertex), patch, worth)
    factor = np.ones(len(xy)) if preferred is None else np.array(preferred)
    return TourSearch(places, TravelCosts(ways), discount_steps=discount, preferred=factor)


def test_of_two_equal_gains_the_one_ahead_is_taken_before_the_one_behind(ways):
    targets = [(8.2, 3.2, {EAST: 5.0}), (4.2, 3.2, {WEST: 5.0})]
    facing_east, facing_west = (search(ways, targets).best(h, depth=2, width=4)[0] for h in (EAST, WEST))
    assert [stop.place for stop in facing_east.stops] == [1, 2]
    assert [stop.place for stop in facing_west.stops] == [2, 1]


def test_two_gains_on_one_side_are_taken_before_a_larger_one_on_the_other(ways):
    targets = [(8.2, 3.2, {EAST: 3.0}), (9.2, 3.2, {EAST: 3.0}), (4.2, 3.2, {WEST: 3.5})]
    best = search(ways, targets, discount=40.0).best(NORTH, depth=3, width=6)[0]
    assert [stop.place for stop in best.stops] == [1, 2, 3]


def test_what_one_view_shows_is_not_counted_again(ways):
    targets = [(8.2, 3.2, {EAST: 5.0}), (8.8, 3.2, {EAST: 5.0})]
    apart = search(ways, targets).best(EAST, depth=2, width=4)[0]
    same = search(ways, targets, patches=[10_000, 10_000]).best(EAST, depth=2, width=4)[0]
    assert sum(stop.gain_m2 for stop in apart.stops) == pytest.approx(10.0, abs=0.1)
    assert sum(stop.gain_m2 for stop in same.stops) == pytest.approx(5.0, abs=0.1)


def test_steps_are_those_of_the_way_and_of_the_turns(ways):
    tour = search(ways, [(8.2, 3.2, {NORTH: 5.0})]).best(EAST, depth=1, width=4)[0]
    (stop,) = tour.stops
    place = ways.graph.vertex_xy_m[int(np.argmin(np.linalg.norm(ways.graph.vertex_xy_m - [8.2, 3.2], axis=1)))]
    forward = math.dist(place, ways.pose.xy_m) / FORWARD_STEP_M
    # The view takes in what lies up to 40 degrees beside its middle, so that half the turn is enough.
    assert stop.at_step == pytest.approx(forward + 5, abs=2.1)
    assert tour.value == pytest.approx(5.0 * math.exp(-stop.at_step / 100.0), rel=1e-5)


def test_a_preferred_place_is_kept_against_one_a_little_better(ways):
    targets = [(8.2, 3.2, {EAST: 5.0}), (4.2, 3.2, {WEST: 5.5})]
    plain = search(ways, targets).best(NORTH, depth=1, width=4)[0]
    kept = search(ways, targets, preferred=[1.0, 1.25, 1.0]).best(NORTH, depth=1, width=4)[0]
    assert (plain.stops[0].place, kept.stops[0].place) == (2, 1)


def test_without_any_gain_there_is_no_tour(ways):
    assert search(ways, [(8.2, 3.2, {})]).best(EAST, depth=3, width=4) == []
