"""What steps cost beside themselves moves tours to other places."""

import numpy as np
import pytest

from anm_mj.planning.paths import shortest_paths
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.policies.gvg.transitions import TURNS, Places, TransitionTable
from anm_mj.planning.policies.gvg.travel_costs import TravelCosts
from anm_mj.planning.policies.gvg.view_tours import best_tours
from anm_mj.planning.policies.gvg.views import NUM_AZIMUTHS
from anm_mj.planning.topdown_mapper import TopDownMapper
from anm_mj.planning.voronoi_graph import voronoi_graph
from anm_mj.types import Footprint, Pose2
from tests.planning.worlds import room, topdown_map

EAST, NORTH, WEST = 0, 9, 18
CONFIG = PlanningConfig(horizon_m=20.0)


@pytest.fixture(scope="module")
def paths():
    """Shortest paths in an empty hall, for a robot in its middle."""
    world, pose = room(12, 6), Pose2(6.2, 3.2, 0.0)
    topdown = topdown_map(TopDownMapper(CONFIG, Footprint(0.18, 0.05, 1.35)), world.occupancy, world.sdf, pose)
    return shortest_paths(voronoi_graph(topdown, pose.xy_m, CONFIG, 0.22), topdown, pose, 0.22)


def table(paths, more_steps=None):
    """Transitions between the robot's place and one on either side that shows something."""
    vertex = [int(np.argmin(np.linalg.norm(paths.graph.vertex_xy_m - [x, 3.2], axis=1))) for x in (8.7, 3.7)]
    xy = np.concatenate([paths.pose.xy_m[None], paths.graph.vertex_xy_m[vertex]])
    gain_m2 = np.zeros((3, NUM_AZIMUTHS), np.float32)
    gain_m2[1, EAST], gain_m2[2, WEST] = 3.0, 2.8
    patch = np.arange(gain_m2.size).reshape(gain_m2.shape)
    return TransitionTable(Places(xy, np.array([-1, *vertex]), patch, gain_m2), TravelCosts(paths), 4, more_steps)


def first(transitions):
    return best_tours(transitions, NORTH, discount_steps=100.0, preference=np.ones(3), depth=1, width=3)[0].views[0]


def test_a_way_that_costs_certainty_comes_second(paths):
    more = np.zeros((3, NUM_AZIMUTHS))
    more[1, EAST] = 0.5

    assert first(table(paths)).place == 1
    assert first(table(paths, more)).place == 2
    # It costs half of that along the way there, from one end.
    plain, dear = (transitions._steps[0, 1] for transitions in (table(paths), table(paths, more)))
    assert dear == pytest.approx(1.25 * plain)


def test_turns_cost_what_they_sweep_over(paths):
    more = np.zeros((3, NUM_AZIMUTHS))
    more[:, [1, 2]] = 2.0

    steps = table(paths, more)._turn_steps[0, EAST]

    left, right = steps[TURNS == 5], steps[TURNS == -5]
    assert (left, right) == (5.0 + 4.0, 5.0)
    assert steps[0] == 0.0
    assert table(paths)._turn_steps[1, NORTH].tolist() == np.abs(TURNS).tolist()
