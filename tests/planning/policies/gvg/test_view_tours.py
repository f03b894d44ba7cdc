import functools
import math

import numpy as np
import pytest

from anm_mj.planning.paths import shortest_paths
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.policies.gvg.transitions import Places, TransitionTable
from anm_mj.planning.policies.gvg.travel_costs import TravelCosts
from anm_mj.planning.policies.gvg.view_tours import best_tours
from anm_mj.planning.policies.gvg.views import NUM_AZIMUTHS
from anm_mj.planning.topdown_mapper import TopDownMapper
from anm_mj.planning.voronoi_graph import voronoi_graph
from anm_mj.types import FORWARD_STEP_M, Footprint, Pose2
from tests.planning.worlds import room, topdown_map

EAST, NORTH, WEST, SOUTH = 0, 9, 18, 27
CONFIG = PlanningConfig(horizon_m=20.0)


@pytest.fixture(scope="module")
def paths():
    """Shortest paths in an empty hall of 12 m by 6 m, for a robot in its middle."""
    world, pose = room(12, 6), Pose2(6.2, 3.2, 0.0)
    topdown = topdown_map(TopDownMapper(CONFIG, Footprint(0.18, 0.05, 1.35)), world.occupancy, world.sdf, pose)
    return shortest_paths(voronoi_graph(topdown, pose.xy_m, CONFIG, 0.22), topdown, pose, 0.22)


def search(paths, targets, patches=None, preference=None, discount=100.0):
    """Best tours among the robot's place and others, for each x, y and {azimuth: gain}; call it with a heading."""
    xy, gain_m2 = [paths.pose.xy_m], np.zeros((len(targets) + 1, NUM_AZIMUTHS), np.float32)
    vertex = [-1]
    patch = np.arange(gain_m2.size).reshape(gain_m2.shape)
    for i, (x, y, gains) in enumerate(targets, 1):
        v = int(np.argmin(np.linalg.norm(paths.graph.vertex_xy_m - [x, y], axis=1)))
        vertex.append(v)
        xy.append(paths.graph.vertex_xy_m[v])
        for azimuth, gain in gains.items():
            gain_m2[i, azimuth] = gain
            if patches:
                patch[i, azimuth] = patches[i - 1]
    places = Places(np.array(xy), np.array(vertex), patch, gain_m2)
    factor = np.ones(len(xy)) if preference is None else np.array(preference)
    table = TransitionTable(places, TravelCosts(paths), 4)
    return functools.partial(best_tours, table, discount_steps=discount, preference=factor)


def test_gain_ahead_comes_before_gain_behind(paths):
    targets = [(8.2, 3.2, {EAST: 5.0}), (4.2, 3.2, {WEST: 5.0})]
    facing_east, facing_west = (search(paths, targets)(h, depth=2, width=4)[0] for h in (EAST, WEST))
    assert [view.place for view in facing_east.views] == [1, 2]
    assert [view.place for view in facing_west.views] == [2, 1]


def test_two_gains_on_one_side_come_before_a_larger_one(paths):
    targets = [(8.2, 3.2, {EAST: 3.0}), (9.2, 3.2, {EAST: 3.0}), (4.2, 3.2, {WEST: 3.5})]
    best = search(paths, targets, discount=40.0)(NORTH, depth=3, width=6)[0]
    assert [view.place for view in best.views] == [1, 2, 3]


def test_gain_counts_once(paths):
    targets = [(8.2, 3.2, {EAST: 5.0}), (8.8, 3.2, {EAST: 5.0})]
    apart = search(paths, targets)(EAST, depth=2, width=4)[0]
    same = search(paths, targets, patches=[10_000, 10_000])(EAST, depth=2, width=4)[0]
    assert sum(view.gain_m2 for view in apart.views) == pytest.approx(10.0, abs=0.1)
    assert sum(view.gain_m2 for view in same.views) == pytest.approx(5.0, abs=0.1)


def test_steps_count_path_and_turns(paths):
    tour = search(paths, [(8.2, 3.2, {NORTH: 5.0})])(EAST, depth=1, width=4)[0]
    (view,) = tour.views
    place = paths.graph.vertex_xy_m[int(np.argmin(np.linalg.norm(paths.graph.vertex_xy_m - [8.2, 3.2], axis=1)))]
    forward = math.dist(place, paths.pose.xy_m) / FORWARD_STEP_M
    # The view takes in what lies up to 40 degrees beside its middle, so that half the turn is enough.
    assert view.at_step == pytest.approx(forward + 5, abs=2.1)
    assert tour.value == pytest.approx(5.0 * math.exp(-view.at_step / 100.0), rel=1e-5)


def test_preference_holds_against_a_little_more_gain(paths):
    targets = [(8.2, 3.2, {EAST: 5.0}), (4.2, 3.2, {WEST: 5.5})]
    plain = search(paths, targets)(NORTH, depth=1, width=4)[0]
    kept = search(paths, targets, preference=[1.0, 1.25, 1.0])(NORTH, depth=1, width=4)[0]
    assert (plain.views[0].place, kept.views[0].place) == (2, 1)


def test_no_gain_no_tour(paths):
    assert search(paths, [(8.2, 3.2, {})])(EAST, depth=3, width=4) == []


def test_a_way_shows_what_the_turns_before_and_after_it_sweep(paths):
    table = search(paths, [(8.2, 3.2, {EAST: 5.0})]).args[0]
    here, there = (set(np.flatnonzero(sectors).tolist()) for sectors in table.swept(NORTH, 1, NORTH))
    # It turns to the east, beyond what it has in view already, and back to the north there; paths may bend a little.
    assert {34, 35, 0, 1, 2, 3, 4} <= here <= {*range(31, 36), *range(5)}
    assert {34, 35, *range(14)} <= there <= {*range(31, 36), *range(14)}
    # It stays and turns: only what its view does not show yet counts.
    here, there = table.swept(NORTH, 0, WEST)
    assert not here.any()
    assert set(np.flatnonzero(there)) == set(range(14, 23))
