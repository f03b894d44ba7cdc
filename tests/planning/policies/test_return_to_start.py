"""Whatever a policy does, the robot is back in time."""

import json
import math
from unittest.mock import Mock

import numpy as np
import pytest

from anm_mj.checkpoint.decode import restore
from anm_mj.checkpoint.encode import encode
from anm_mj.checkpoint.known_classes import KnownClasses
from anm_mj.control.action_motion import action_motion
from anm_mj.control.path_follower import Follower
from anm_mj.frames import move_pose, wrap_angle
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.policies.guarded_policy import plan_fault
from anm_mj.planning.policies.return_to_start import ReturnToStart
from anm_mj.protocols import Mapper
from anm_mj.types import (
    ARRIVED_M,
    FREE,
    OCCUPIED,
    TURN_STEP_RAD,
    Action,
    Footprint,
    OccupancyGrid,
    Plan,
    Pose2,
    StopReason,
)
from tests.box_room import observe

BODY = Footprint(0.18, 0.05, 1.35)
START = Pose2(0.5, 0.5, 0.3)
NOWHERE = np.zeros((0, 2))


def hall(wall=True):
    """A hall of 6 m by 4 m, a wall across it up to a door."""
    state = np.full((32, 80, 128), OCCUPIED, np.int8)
    state[1:, 2:78, 2:118] = FREE
    if wall:
        state[:, :60, 40:42] = OCCUPIED
    columns = np.full((5, 8), 1, np.int32)
    return OccupancyGrid(state, np.ones(state.shape, np.float32), np.array([0.0, 0.0, -0.025]), 0.05, 1, columns)


def mapper_of(grid):
    def sdf(points):
        return np.full(len(points), 0.1, np.float32)

    return Mock(Mapper, occupancy_grid=lambda: grid, sdf=sdf, truncation_m=0.1)


class Goes:
    """A policy that goes to places one after the other, then stops."""

    def __init__(self, *places, stop=StopReason.COMPLETE):
        self.places, self.stop = list(places), stop

    def observe(self, observation): ...

    def plan(self, mapper, observation):
        while self.places and math.dist(self.places[0], observation.pose.xy_m) < ARRIVED_M:
            self.places.pop(0)
        if not self.places:
            return Plan("all seen", NOWHERE, stop=self.stop)
        return Plan("on", np.array([observation.pose.xy_m, self.places[0]]))

    def on_collision(self, pose, action): ...


class Turns(Goes):
    def plan(self, mapper, observation):
        return Plan("round and round", NOWHERE, actions=(Action.TURN_LEFT,) * 36)


def drive(policy, mapper, num_steps):
    """The last plan, the last pose and the number of steps, as the loop would have them."""
    pose, follower = START, Follower()
    policy.observe(observe(0, pose))
    for step in range(num_steps):
        action = follower.next_action(pose)
        if action is None:
            plan = policy.plan(mapper, observe(step, pose))
            if plan.stop is not None:
                return plan, pose, step
            follower.start(plan)
            action = follower.next_action(pose)
            assert action is not None, plan.reason
        pose = move_pose(pose, *action_motion(action))
        policy.observe(observe(step + 1, pose))
    return None, pose, num_steps


def returning(policy, num_steps):
    return ReturnToStart(policy, PlanningConfig(), BODY, num_steps)


def is_back(pose):
    aligned = abs(wrap_angle(pose.yaw_rad - START.yaw_rad)) < 0.6 * TURN_STEP_RAD
    return math.dist(pose.xy_m, START.xy_m) < ARRIVED_M and aligned


def test_the_robot_goes_back_when_all_is_explored():
    policy = returning(Goes((1.5, 3.4), (2.5, 3.4), (4.0, 1.0)), 1000)
    plan, pose, steps = drive(policy, mapper_of(hall()), 1000)
    assert plan.stop is StopReason.COMPLETE
    assert is_back(pose)
    assert policy.explored_steps < steps
    assert f"back at the start after {steps - policy.explored_steps} steps" in plan.reason


@pytest.mark.parametrize("num_steps", [20, 90, 150, 210])
@pytest.mark.parametrize("explores", [Goes((1.5, 3.4), (2.5, 3.4), (5.5, 1.0), (1.0, 1.0), (5.5, 0.5)), Turns()])
def test_the_robot_is_back_before_the_budget_is_spent(num_steps, explores):
    import copy

    plan, pose, steps = drive(returning(copy.deepcopy(explores), num_steps), mapper_of(hall()), num_steps)
    assert plan is not None
    assert plan.stop is StopReason.RETURNED
    assert is_back(pose)
    # And it has made use of the budget.
    assert steps > 0.4 * num_steps - 10


@pytest.mark.parametrize("x", [-0.3, 6.7])
def test_a_map_that_does_not_hold_the_robot_yet_ends_no_run(x):
    """A camera ahead of the base may see nothing of the block of voxels that the base stands in."""
    policy = returning(Goes((3.0, 2.0)), 100)
    for step, pose in enumerate((Pose2(x, 2.0, 0.0), Pose2(x + math.copysign(0.2, 3.0 - x), 2.0, 0.0))):
        policy.observe(observe(step, pose))
        plan = policy.plan(mapper_of(hall(wall=False)), observe(step, pose))
        assert plan.reason == "on"


def test_other_ends_are_ends():
    policy = returning(Goes(stop=StopReason.POLICY_ERROR), 500)
    plan, _, steps = drive(policy, mapper_of(hall()), 500)
    assert (plan.stop, steps) == (StopReason.POLICY_ERROR, 0)
    assert policy.explored_steps is None


def test_a_robot_that_never_left_is_back_at_once():
    plan, _, steps = drive(returning(Goes(), 500), mapper_of(hall()), 500)
    assert (plan.stop, steps) == (StopReason.COMPLETE, 0)


def test_a_way_that_is_blocked_is_said():
    policy = returning(Goes((3.0, 3.4)), 500)
    policy.observe(observe(0, START))
    grid = hall()
    grid.state[:, :, 20:22] = OCCUPIED
    there = Pose2(3.0, 3.4, 0.0)
    policy.observe(observe(50, there))
    plan = policy.plan(mapper_of(grid), observe(50, there))
    assert "the nearest place to the start" in plan.reason
    nearest = Pose2(*plan.path_xy_m[-1], 0.0)
    plan = policy.plan(mapper_of(grid), observe(90, nearest))
    assert plan.stop is StopReason.COMPLETE
    assert "no path leads back" in plan.reason


def test_a_robot_in_the_cell_of_its_start_goes_there():
    """Cells are so wide that the start lies farther off than the robot calls arrived."""
    state = np.full((16, 32, 32), OCCUPIED, np.int8)
    state[1:, 1:31, 1:31] = FREE
    columns = np.full((2, 2), 1, np.int32)
    grid = OccupancyGrid(state, np.ones(state.shape, np.float32), np.array([0.0, 0.0, -0.1]), 0.2, 1, columns)
    policy = returning(Goes(), 500)
    policy.observe(observe(0, Pose2(3.05, 3.1, 0.0)))
    beside = observe(1, Pose2(3.18, 3.1, 0.0))
    policy.observe(beside)
    plan = policy.plan(mapper_of(grid), beside)
    assert plan_fault(plan, beside.pose) is None
    np.testing.assert_allclose(plan.path_xy_m, [[3.18, 3.1], [3.05, 3.1]])


def test_a_resumed_run_has_the_budget_that_it_was_given():
    known = KnownClasses(__name__)
    graph = encode({"policy": returning(Turns([]), 500)}, known)
    nodes, arrays = json.loads(json.dumps(graph.nodes)), [array.copy() for array in graph.arrays]
    resumed = restore(nodes, arrays, {"policy": returning(Turns([]), 2000)}, known)["policy"]
    assert resumed._num_steps == 2000
