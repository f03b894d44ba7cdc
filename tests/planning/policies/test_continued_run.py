"""Policies begin with what a prior run explored."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from anm_mj.errors import PlanError
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.continued_run import LookingAround, is_known_place, remembered
from anm_mj.planning.policies.guarded_policy import GuardedPolicy
from anm_mj.planning.policies.registry import default_settings, make_policy, needs_truth, policies
from anm_mj.planning.scan_grid import ScanGrid
from anm_mj.planning.topdown_mapper import TopDownMapper
from anm_mj.protocols import Continues, Mapper, Policy
from anm_mj.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    Action,
    ExploredState,
    Footprint,
    OccupancyGrid,
    Plan,
    Pose2,
    StopReason,
)
from tests.box_room import observe
from tests.planning.worlds import topdown_map

BODY = Footprint(0.18, 0.05, 1.35)
POSES = np.array([[0.5, 0.5, 0.0], [1.0, 0.5, 0.0], [1.0, 0.5, 1.5]])
REFUSED = np.array([[1.0, 0.5, 0.0]])
NOWHERE = np.zeros((0, 2))


def room_grid():
    """Known floor of 4 m by 4 m about the origin's corner, with a wall in the middle, unknown beyond."""
    state = np.full((32, 96, 96), UNKNOWN, np.int8)
    state[:, 16:80, 16:80] = FREE
    state[0] = np.where(state[0] == FREE, np.int8(OCCUPIED), state[0])
    state[:, 16:80, 60:62] = OCCUPIED
    columns = np.full((6, 6), 1, np.int32)
    return OccupancyGrid(state, np.ones(state.shape, np.float32), np.array([-1.0, -1.0, -0.025]), 0.05, 1, columns)


def far_sdf(points):
    return np.full(len(points), 0.1, np.float32)


@pytest.mark.parametrize("name", [name for name in policies() if not needs_truth(name)])
def test_what_a_policy_remembers_is_what_it_begins_with(name):
    first = make_policy(name, PolicyContext(BODY, default_settings(name)))
    if not isinstance(first, Continues):
        assert not hasattr(first, "memory")
        return
    mapper = Mock(Mapper, occupancy_grid=room_grid)
    first.observe(observe(0, Pose2(0.5, 0.5, 0.0)))
    memory = {key: value.copy() for key, value in first.memory().items()}
    second = make_policy(name, PolicyContext(BODY, default_settings(name)))
    second.continue_from(ExploredState(name, POSES, REFUSED[:0], memory), mapper)
    again = second.memory()
    assert set(again) == set(memory)
    for key, value in memory.items():
        np.testing.assert_array_equal(np.isnan(again[key]), np.isnan(value))
        np.testing.assert_array_equal(np.nan_to_num(again[key]) > 0, np.nan_to_num(value) > 0)
    # Of another policy's run it knows the map.
    third = make_policy(name, PolicyContext(BODY, default_settings(name)))
    third.continue_from(ExploredState("other", POSES, REFUSED), mapper)


def test_a_memory_of_another_shape_is_refused():
    prior = ExploredState("own", POSES, REFUSED, {"grid": np.zeros((3, 2)), "words": np.array(["a"])})
    assert remembered(prior, "grid", (None, 2)) is not None
    assert remembered(prior, "nothing", (2,)) is None
    for name, shape in (("grid", (2,)), ("grid", (None, 3)), ("words", (1,))):
        with pytest.raises(PlanError, match=name):
            remembered(prior, name, shape)


def test_a_scan_grid_reads_the_map_of_another_policy():
    grid = ScanGrid(BODY, 3.0)
    grid.read_occupancy(room_grid(), POSES)
    topdown = grid.topdown()

    def at(x, y):
        col, row = np.floor((np.array([x, y]) - topdown.origin_xy_m) / topdown.resolution_m).astype(int)
        return topdown.state[row, col]

    assert at(0.5, 1.5) == FREE
    assert at(2.05, 1.5) == OCCUPIED
    assert at(3.5, 1.5) == UNKNOWN
    scans = ScanGrid(BODY, 3.0)
    scans.continue_from(np.where(topdown.state == OCCUPIED, 3.0, -2.0), topdown.origin_xy_m)
    assert scans.log_odds.max() < 1.2


def test_the_floor_of_a_former_run_is_free_unless_something_stands_there_now():
    grid = room_grid()
    mapper = TopDownMapper(PlanningConfig(), BODY)
    mapper.continue_from(np.array([[0.5, 0.5], [2.05, 0.5], [3.4, 0.5]]))
    mapper.visit(np.array([0.5, 2.0]))
    topdown = topdown_map(mapper, grid, far_sdf, Pose2(0.5, 2.0, 0.0))

    def at(x, y):
        col, row = np.floor((np.array([x, y]) - topdown.origin_xy_m) / topdown.resolution_m).astype(int)
        return topdown.state[row, col]

    assert at(2.05, 0.5) == OCCUPIED  # A wall stands where it drove.
    assert at(3.4, 0.5) == FREE  # Nobody has seen it, but it drove there.
    assert len(mapper.trajectory_xy_m) == 4


def test_a_place_is_known_near_the_former_trajectory():
    assert is_known_place(POSES, observe(0, Pose2(1.5, 0.5, 0.0)))
    assert not is_known_place(POSES, observe(0, Pose2(2.5, 0.5, 0.0)))
    assert not is_known_place(POSES[:0], observe(0, Pose2(0.5, 0.5, 0.0)))


def test_a_continued_run_looks_around_before_it_ends():
    stop = Plan("nothing left", NOWHERE, stop=StopReason.COMPLETE)
    policy = LookingAround(Mock(Policy, plan=Mock(return_value=stop)))
    first = policy.plan(Mock(Mapper), observe(0, Pose2(1.0, 1.0, 0.0)))
    assert set(first.actions) == {Action.TURN_LEFT}
    assert 9 <= len(first.actions) <= 36
    assert policy.plan(Mock(Mapper), observe(len(first.actions), Pose2(1.0, 1.0, 0.0))) is stop
    failed = replace(stop, stop=StopReason.POLICY_ERROR)
    assert (
        LookingAround(Mock(Policy, plan=Mock(return_value=failed))).plan(Mock(Mapper), observe(0, Pose2(1.0, 1.0, 0.0)))
        is failed
    )


class Faulty:
    def observe(self, observation): ...

    def plan(self, mapper, observation):
        return Plan("go", np.array([[9.0, 9.0]]))

    def on_collision(self, pose, action): ...

    def memory(self):
        return {"a": np.zeros(2), "b": "no array"}

    def continue_from(self, prior, mapper):
        raise KeyError("what")


def test_a_policy_that_fails_to_take_over_ends_the_run_with_a_sentence():
    policy = GuardedPolicy(Faulty(), "own")
    assert set(policy.memory()) == {"a"}
    policy.continue_from(ExploredState("own", POSES, REFUSED), Mock(Mapper))
    plan = policy.plan(Mock(Mapper), observe(0, Pose2(1.0, 1.0, 0.0)))
    assert plan.stop is StopReason.POLICY_ERROR
    assert "continue_from" in plan.reason
