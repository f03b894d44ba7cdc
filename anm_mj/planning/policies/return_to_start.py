"""Brings the robot back to where it began, whatever policy explores, before the budget of steps is spent."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from anm_mj.frames import wrap_angle
from anm_mj.geometry.polyline import NUM_HEADINGS
from anm_mj.planning.grid_route import GridRoutes
from anm_mj.planning.paths import path_steps
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.stages import Stages
from anm_mj.protocols import Mapper, Policy
from anm_mj.types import ARRIVED_M, TURN_STEP_RAD, Action, Footprint, Observation, Plan, Pose2, StopReason
from anm_mj.utils.stopwatch import Stopwatch

SLOWER, SPARE_STEPS = 1.25, 12
"""The return takes this factor more steps than its length says, and these: turns on the path, detours."""
NEAR_START_M = 1.0
"""Nearer to the start than this, the direction of the return changes quickly [m]."""
REPLAN_STEPS = 25
"""The return is planned again after this many steps."""
ALIGNED_RAD = 0.56 * TURN_STEP_RAD
"""The robot looks where it looked at the start when it is off by no more than this [rad]; no turn brings it nearer."""
ENDS = (StopReason.COMPLETE, StopReason.NO_REACHABLE_TARGET)
"""After these ends of the exploration the robot drives back; after all others it stops where it is."""


class _Return(NamedTuple):
    """A path to the start, or as near to it as the map allows."""

    path_xy_m: Float[np.ndarray, "k 2"]
    steps: float
    arrives: bool


class ReturnToStart:
    """A policy that ends at its start: it drives back when the exploration is over, or in time for the budget."""

    # A run that is resumed may have been given another budget.
    REBUILT = ("_num_steps", "confirm")

    def __init__(self, policy: Policy, config: PlanningConfig, footprint: Footprint, num_steps: int | None) -> None:
        """Wrap a policy that explores; the budget is ``num_steps`` discrete actions. None = it is told when to end."""
        self._policy = policy
        self._stages = Stages(config, footprint)
        self._clearances_m = self._stages.safe_m, footprint.radius_m, 0.5 * footprint.radius_m
        self._num_steps = num_steps
        self._start: Pose2 | None = None
        self.confirm: Callable[[Plan, Mapper], Plan] = lambda plan, _: plan
        """Called with the policy's plan: puts off an end that something which moves about may have caused."""
        self._end: Plan | None = None
        """The end of the exploration; None while it goes on."""
        self._end_step = 0

    @property
    def explored_steps(self) -> int | None:
        """Steps before the return; None as long as the robot explores."""
        return None if self._end is None else self._end_step

    def end(self, reason: str, step: int) -> None:
        """End the exploration after so many actions; the next plan leads back."""
        if self._end is None:
            self._end, self._end_step = Plan(reason, stop=StopReason.RETURNED), step

    def observe(self, observation: Observation) -> None:
        """Note where the robot is; the first place is where it goes back to."""
        self._start = self._start or observation.pose
        self._stages.observe(observation)
        self._policy.observe(observation)

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """The policy's decision as long as the return leaves steps for it, then the return."""
        if self._end is not None:
            return self._go_back(mapper, observation, self._end)
        if self._num_steps is None:
            return self.confirm(self._policy.plan(mapper, observation), mapper)
        spare = self._spare_steps(mapper, observation)
        in_time = spare < 1
        if in_time:
            reason = f"exploring ends at step {observation.step} of {self._num_steps}, in time for the return"
            plan = Plan(reason, stop=StopReason.RETURNED)
        else:
            plan = self.confirm(self._policy.plan(mapper, observation), mapper)
        if in_time or plan.stop in ENDS:
            self._end, self._end_step = plan, observation.step
            return self._go_back(mapper, observation, plan)
        if plan.stop is not None:
            return plan
        most_steps = math.floor(spare)
        if plan.actions:
            return replace(plan, actions=plan.actions[:most_steps])
        return replace(plan, valid_steps=min(plan.valid_steps or most_steps, most_steps))

    def on_collision(self, pose: Pose2, action: Action) -> None:
        """Mark the obstacle, and pass it on to the policy."""
        self._stages.on_collision(pose, action)
        if self._end is None:
            self._policy.on_collision(pose, action)

    def _go_back(self, mapper: Mapper, observation: Observation, end: Plan) -> Plan:
        """The next part of the return, or the end."""
        assert self._start is not None, "observe comes first"
        pose = observation.pose
        away_m = math.dist(pose.xy_m, self._start.xy_m)
        if away_m < ARRIVED_M:
            if abs(wrap_angle(self._start.yaw_rad - pose.yaw_rad)) > ALIGNED_RAD:
                return Plan("return: the heading of the start", headings_rad=(self._start.yaw_rad,))
            taken = observation.step - self._end_step
            return replace(end, reason=f"{end.reason}; back at the start after {taken} steps")
        path, steps, arrives = self._return(mapper, observation)
        if not len(path):
            stop = StopReason.NO_REACHABLE_TARGET if end.stop is StopReason.RETURNED else end.stop
            reason = f"{end.reason}; no path leads back to the start, {away_m:.1f} m away"
            return replace(end, reason=reason, stop=stop)
        where = "the start" if arrives else "the nearest place to the start"
        return Plan(f"return: {steps:.0f} steps to {where}", path, valid_steps=REPLAN_STEPS)

    def _spare_steps(self, mapper: Mapper, observation: Observation) -> float:
        """Steps that the robot may still take before it has to think of the return again."""
        assert self._start is not None, "observe comes first"
        assert self._num_steps is not None
        left = self._num_steps - observation.step - SPARE_STEPS
        # Nobody needs more steps to go back than to come here, with a turn at both ends.
        spare = (left - SLOWER * (observation.step + NUM_HEADINGS)) / (1.0 + SLOWER)
        if spare >= REPLAN_STEPS:
            return spare
        back_steps = self._return(mapper, observation).steps
        if math.dist(observation.pose.xy_m, self._start.xy_m) < NEAR_START_M:
            # One step away from here may take a turn at both ends.
            return (left - SLOWER * (back_steps + NUM_HEADINGS)) / (1.0 + SLOWER)
        # Each step away costs another one on the return, or a turn, or a bit of both.
        return (left - SLOWER * back_steps) / (1.0 + 1.5 * SLOWER)

    def _return(self, mapper: Mapper, observation: Observation) -> _Return:
        """The shortest path to the start, with less clearance where there is none with enough."""
        assert self._start is not None, "observe comes first"
        start, pose = self._start, observation.pose
        topdown, _ = self._stages.update_map(mapper, observation, Stopwatch())
        if math.dist(pose.xy_m, start.xy_m) < ARRIVED_M:
            turns = abs(wrap_angle(start.yaw_rad - pose.yaw_rad)) / TURN_STEP_RAD
            return _Return(np.zeros((0, 2)), turns, arrives=True)
        routes = GridRoutes(topdown, pose, self._clearances_m[0])
        for safe_m in self._clearances_m[1:]:
            if not math.isfinite(routes.cost_at(start.xy_m)):
                routes = GridRoutes(topdown, pose, safe_m)
        if math.isfinite(routes.cost_at(start.xy_m)):
            path = routes.path_to(start.xy_m)
            # In the start's own cell there is nothing between.
            path = np.concatenate([path[: max(len(path) - 1, 1)], start.xy_m[None]])
            return _Return(path, path_steps(path, pose.yaw_rad, start.yaw_rad), arrives=True)
        nearest = routes.nearest(start.xy_m)
        if math.dist(nearest, pose.xy_m) < 2 * ARRIVED_M:
            return _Return(np.zeros((0, 2)), 0.0, arrives=False)
        path = routes.path_to(nearest)
        return _Return(path, path_steps(path, pose.yaw_rad), arrives=False)
