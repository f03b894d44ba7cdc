"""The steps of the loop that touch a stage, with what may go wrong there."""

import logging
import math
from dataclasses import replace

import numpy as np

from anm_mj.errors import MapError
from anm_mj.localisation.localiser import Localiser, PoseEstimate, TrackingState, look_around
from anm_mj.loop_state import LoopState
from anm_mj.planning.steps_ahead import held_disc, in_the_way, lookahead_radius_m, path_is_blocked
from anm_mj.protocols import FindsMoved, Mapper, Policy, Robot
from anm_mj.types import Action, MapUpdate, Observation, Plan, StopReason
from anm_mj.utils.stopwatch import Stopwatch

_logger = logging.getLogger(__name__)

PATIENT_TURNS = 3
"""After so many turns in place of a forward move, the policy looks for another way."""
UNTRAINED = MapUpdate(math.nan, 0, 0)
"""Of a frame that the map has not learnt from."""


def observe(
    robot: Robot, mapper: Mapper, state: LoopState, action: Action, *, moved: bool, judges_pose: bool
) -> Observation | None:
    """The frame after an action, which ``moved`` the robot or not, checked as by
    :meth:`~anm_mj.sensing.sensor_monitor.SensorMonitor.check`; None where the camera fails, whatever its driver raises.
    """
    try:
        seen = robot.observe()
    except Exception as err:
        _logger.error("The camera failed (%s: %s); the run ends.", type(err).__name__, err)
        return None
    return state.monitor.check(
        seen, action=action, moved=moved, sdf_m=mapper.sdf, grid_at=mapper.occupancy_grid, judges_pose=judges_pose
    )


def localise(
    observation: Observation, localiser: Localiser | None, state: LoopState, watch: Stopwatch
) -> tuple[Observation, PoseEstimate | None]:
    """The frame with its estimated pose; a plan made from another pose than that ends."""
    if localiser is None:
        return observation, None
    with watch.stage("localise"):
        estimate = localiser.localise(observation)
    is_lost = estimate.state is TrackingState.LOST
    if is_lost != (state.lost_steps > 0):
        state.follower.drop()
    state.lost_steps = state.lost_steps + 1 if is_lost else 0
    return estimate.observation, estimate


def find_moved(
    observation: Observation, estimate: PoseEstimate | None, mapper: Mapper
) -> tuple[Observation, PoseEstimate | None]:
    """The frame, and its estimate, with moved pixels told apart, where the map knows them and the pose is good."""
    if not isinstance(mapper, FindsMoved) or (estimate is not None and not estimate.usable):
        return observation, estimate
    seen = mapper.find_moved(observation)
    return seen, None if estimate is None else replace(estimate, observation=seen)


def integrate(
    observation: Observation, estimate: PoseEstimate | None, localiser: Localiser | None, mapper: Mapper
) -> MapUpdate:
    """Take a frame into the map; no pixel enters it from a pose that is not good enough. Raises MapError if the map
    cannot be trained any further.
    """
    if estimate is None or localiser is None:
        return mapper.integrate(observation)
    return localiser.integrate(estimate) if estimate.usable else UNTRAINED


def learn(
    observation: Observation,
    estimate: PoseEstimate | None,
    localiser: Localiser | None,
    mapper: Mapper,
    policy: Policy,
    watch: Stopwatch,
) -> MapUpdate | None:
    """Take a frame into the map, and tell the policy; None where the map cannot be trained any further.

    A policy hears of no frame whose pose is not good enough for the map: it would count as seen what is not.
    """
    try:
        with watch.stage("map"):
            update = integrate(observation, estimate, localiser, mapper)
    except MapError as err:
        _logger.error("%s The run ends.", err)
        return None
    if estimate is None or estimate.usable:
        with watch.stage("plan"):
            policy.observe(observation)
    return update


def decide(robot: Robot, mapper: Mapper, policy: Policy, state: LoopState) -> tuple[Action | None, Plan, bool]:
    """The next action, None if the plan holds none; the plan that it belongs to; and whether that is a new one."""
    observation, plan, follower = state.observation, state.plan, state.follower
    assert observation is not None
    action = follower.next_action(observation.pose)
    decided = action is None or is_blocked(action, plan, robot, mapper, observation)
    if state.monitor.must_look_around:
        # A policy that looks one way only would never tell a broken camera from a wall too near to be measured.
        decided, plan = True, _one_turn("no depth for long: looks around")
        follower.start(plan)
        action = follower.next_action(observation.pose)
    elif decided:
        plan = look_around(state.lost_steps)
        plan = plan or doubt_stop(policy.plan(mapper, observation), mapper, state)
        follower.start(plan)
        action = follower.next_action(observation.pose)
    if action is Action.MOVE_FORWARD and not state.monitor.sees:
        decided, plan = True, wait_for_sight(state, policy)
        follower.start(plan)
        action = follower.next_action(observation.pose)
    if action is not None:
        action = give_way(action, robot, mapper, state)
    assert plan is not None  # The follower has no action without a plan.
    return action, plan, decided


def is_blocked(
    action: Action | None, plan: Plan | None, robot: Robot, mapper: Mapper, observation: Observation
) -> bool:
    """Whether the map now shows an obstacle on the planned path; fixed actions are executed without a check."""
    if action is not Action.MOVE_FORWARD or plan is None or plan.actions:
        return False
    grid = mapper.occupancy_grid(observation.pose.xy_m, lookahead_radius_m(robot.footprint))
    return path_is_blocked(grid, robot.footprint, observation.pose)


def give_way(action: Action, robot: Robot, mapper: Mapper, state: LoopState) -> Action:
    """The action, or a wait in place of a forward step towards something that moves.

    When patience is at an end, what moves becomes an obstacle of the map for now, and the plan ends.
    """
    seen = state.observation
    assert seen is not None
    if action is not Action.MOVE_FORWARD:
        return action
    thing = in_the_way(state.things.things, robot.footprint, seen.pose, seen.time_s)
    if thing is None:
        state.waited = 0
        return action
    state.waited += 1
    if state.waited % state.patience_steps == 0 and isinstance(mapper, FindsMoved):
        mapper.hold_moved(np.array([held_disc(thing, robot.footprint, seen.pose, seen.time_s)]))
        state.follower.drop()
    state.follower.put_off()
    return Action.WAIT


def doubt_stop(plan: Plan, mapper: Mapper, state: LoopState) -> Plan:
    """A wait in place of an end of the run that something which moves about may have caused, or what is left of it."""
    if plan.actions == (Action.WAIT,):
        return plan  # It was put off before, by a policy that would return to the start.
    if plan.stop not in (StopReason.COMPLETE, StopReason.NO_REACHABLE_TARGET):
        state.doubted_stops = 0
        return plan
    finds = isinstance(mapper, FindsMoved)
    held = finds and mapper.release_moved()
    if state.doubted_stops < state.patience_steps and (held or state.things.things):
        state.doubted_stops += 1
        reason = f"something moves about: waits instead of {plan.stop}"
    elif finds and mapper.doubt_moved():
        reason = f"something moved about: doubts what may be left of it, instead of {plan.stop}"
    else:
        return plan
    return Plan(reason, actions=(Action.WAIT,))


def wait_for_sight(state: LoopState, policy: Policy) -> Plan:
    """A turn in place of a forward move that the last frame tells nothing about."""
    assert state.observation is not None
    state.blind_turns += 1
    if state.blind_turns % PATIENT_TURNS == 0:
        policy.on_collision(state.observation.pose, Action.MOVE_FORWARD)
    return _one_turn("nothing is seen ahead: turns instead of driving")


def _one_turn(reason: str) -> Plan:
    return Plan(reason, actions=(Action.TURN_LEFT,))
