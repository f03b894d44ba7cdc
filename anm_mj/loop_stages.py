"""The steps of the loop that touch a stage, with what may go wrong there."""

from __future__ import annotations

import logging
import math

import numpy as np

from anm_mj.errors import MapError
from anm_mj.localisation.localiser import Localiser, PoseEstimate, TrackingState
from anm_mj.loop_state import LoopState
from anm_mj.planning.blocked_path import lookahead_radius_m, path_is_blocked
from anm_mj.protocols import Mapper, Policy, Robot
from anm_mj.types import Action, MapUpdate, Observation, Plan
from anm_mj.utils.stopwatch import Stopwatch

_logger = logging.getLogger(__name__)

PATIENT_TURNS = 3
"""After so many turns in place of a forward move, the policy looks for another way."""
UNTRAINED = MapUpdate(math.nan, 0, 0)
"""Of a frame that the map has not learnt from."""


def observe(robot: Robot) -> Observation | None:
    """The next frame; None where the camera fails, whatever its driver raises then."""
    try:
        return robot.observe()
    except Exception as err:
        _logger.error("The camera failed (%s: %s); the run ends.", type(err).__name__, err)
        return None


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


def integrate(
    observation: Observation, estimate: PoseEstimate | None, localiser: Localiser | None, mapper: Mapper
) -> MapUpdate:
    """Take a frame into the map; no pixel enters it from a pose that is not good enough.

    Raises:
        MapError: the map cannot be trained any further.
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


def is_blocked(
    action: Action | None, plan: Plan | None, robot: Robot, mapper: Mapper, observation: Observation
) -> bool:
    """Whether the map now shows an obstacle on the planned path; fixed actions are executed without a check."""
    if action is not Action.MOVE_FORWARD or plan is None or plan.actions:
        return False
    grid = mapper.occupancy_grid(observation.pose.xy_m, lookahead_radius_m(robot.footprint))
    return path_is_blocked(grid, robot.footprint, observation.pose)


def wait_for_sight(state: LoopState, policy: Policy) -> Plan:
    """A turn in place of a forward move that the last frame tells nothing about."""
    assert state.observation is not None
    state.blind_turns += 1
    if state.blind_turns % PATIENT_TURNS == 0:
        policy.on_collision(state.observation.pose, Action.MOVE_FORWARD)
    return Plan("nothing is seen ahead: turns instead of driving", np.zeros((0, 2)), actions=(Action.TURN_LEFT,))
