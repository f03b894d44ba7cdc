"""The loop: observe, learn, decide, act, until the budget is spent or nothing is left to see. Start reading here.

scene -> simulator -> observation -> neural map -> top-down map -> graph -> regions -> target -> path -> discrete
actions -> wheel commands -> (again). The loop sees the stages through :mod:`anm_mj.protocols` only. Each can be
replaced: by a real robot, another map, another policy.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass

from anm_mj.control.path_follower import Follower
from anm_mj.errors import MapError, PlanError
from anm_mj.planning.blocked_path import lookahead_radius_m, path_is_blocked
from anm_mj.protocols import Anticipates, Mapper, Policy, Recorder, Robot, Viewer
from anm_mj.sensing.sensor_monitor import SensorMonitor
from anm_mj.types import Action, MapUpdate, Observation, Plan, Pose2, StopReason
from anm_mj.utils.stopwatch import Stopwatch

_logger = logging.getLogger(__name__)

_UNTRAINED = MapUpdate(math.nan, 0, 0)

STUCK_COLLISIONS = 12
"""A robot that collides this often on its path, without a free step in between, is stuck."""


@dataclass(frozen=True)
class StepReport:
    """The state of a run after a step."""

    step: int
    observation: Observation
    plan: Plan
    update: MapUpdate
    loop_s: float
    """Time spent in the loop so far, without set-up and recording [s]."""


class LoopState:
    """What the loop itself remembers between two steps."""

    def __init__(self) -> None:
        """Before the first observation."""
        self.step = 0
        """Number of actions so far."""
        self.follower = Follower()
        self.monitor = SensorMonitor()
        self.total = Stopwatch()
        """Time spent in the loop, without set-up and recording."""
        self.collisions = 0
        """On paths, without a free step in between."""
        self.map_failed = False
        """Whether the map cannot be trained any further."""
        self.plan: Plan | None = None
        self.observation: Observation | None = None
        """The last one."""

    @property
    def loop_s(self) -> float:
        """Time spent in the loop so far [s]."""
        return sum(self.total.ms.values()) / 1e3


@dataclass(frozen=True)
class Outcome:
    """The end of a run."""

    stop_reason: StopReason
    num_steps: int
    loop_s: float
    """Time spent in the loop, without set-up and recording [s]."""
    observation: Observation
    """The last one."""


def explore(
    robot: Robot,
    mapper: Mapper,
    policy: Policy,
    *,
    num_steps: int,
    recorder: Recorder,
    viewer: Viewer,
    stop_requested: Callable[[], bool] = lambda: False,
    on_step: Callable[[StepReport], None] = lambda report: None,
    state: LoopState | None = None,
    between_steps: Callable[[LoopState], None] = lambda state: None,
) -> Outcome:
    """Explore until a ``StopReason`` comes up.

    Args:
        robot: observes once before the first action and once after every action.
        mapper: learns from every observation.
        policy: hears every observation, and plans whenever the last plan is done, outdated or blocked.
        num_steps: budget of discrete actions; turns and collisions count.
        recorder: records the run.
        viewer: shows the run.
        stop_requested: asked before every step; True ends the run with INTERRUPTED.
        on_step: called after every step.
        state: where a former call stood, to go on from there with the robot, mapper and policy of then; None = at the
            start. It is kept up to date.
        between_steps: called before every step, when nothing is in between.

    Raises:
        PlanError: the policy returned a plan that asks for nothing.
    """
    state = state or LoopState()
    if state.observation is None:
        with state.total.stage("observe"):
            first = state.monitor.check(robot.observe())
        state.map_failed = _learn(first, mapper, policy, state.total) is None
        state.observation = first
        recorder.observation(first)
    observation, plan = state.observation, state.plan
    ahead = robot if isinstance(robot, Anticipates) else None

    def outcome(reason: StopReason) -> Outcome:
        return Outcome(reason, state.step, state.loop_s, observation)

    if state.map_failed:
        return outcome(StopReason.MAP_ERROR)
    for step in range(state.step + 1, num_steps + 1):
        between_steps(state)
        if stop_requested():
            return outcome(StopReason.INTERRUPTED)
        watch = Stopwatch()
        with watch.stage("plan"):
            action = state.follower.next_action(observation.pose)
            decided = action is None or _is_blocked(action, plan, robot, mapper, observation)
            if decided:
                plan = policy.plan(mapper, observation)
                state.follower.start(plan)
                action = state.follower.next_action(observation.pose)
        assert plan is not None  # The follower has no action without a plan.
        if decided:
            recorder.plan(step - 1, plan)
        if plan.stop is not None:
            state.total.add(watch)
            # What a blind robot says about its surroundings means nothing.
            return outcome(StopReason.SENSOR_FAULT if state.monitor.is_blind else plan.stop)
        if action is None:
            raise PlanError(f"The policy's plan at step {step} ('{plan.reason}') holds neither an action nor a stop.")

        with watch.stage("act"):
            result = robot.act(action)
        if result.collided:
            policy.on_collision(observation.pose, action)
            state.follower.drop()
            state.collisions += not plan.actions
        elif action is Action.MOVE_FORWARD:
            state.collisions = 0
        with watch.stage("observe"):
            seen = _observe(robot)
        if seen is None:
            state.total.add(watch)
            state.step = step
            return outcome(StopReason.SENSOR_FAULT)
        with watch.stage("observe"):
            # A policy that gives single actions may want another one next.
            done = None if result.collided or plan.actions else action
            coming = _coming_actions(state.follower, seen.pose, done) if ahead is not None else []
            if ahead is not None:
                ahead.anticipate(*coming[:1])
            observation = state.monitor.check(seen, action=action, moved=not result.collided, sdf_m=mapper.sdf)
        update = _learn(observation, mapper, policy, watch)
        if ahead is not None:
            with watch.stage("observe"):
                # One more than the next: it is drawn while the run records, decides and moves, on one core.
                if observation.pose != seen.pose:
                    coming = _coming_actions(state.follower, observation.pose, done)
                ahead.anticipate(*coming)
        with watch.stage("view"):
            viewer.show(observation, mapper, plan)
        state.total.add(watch)
        state.step, state.plan, state.observation = step, plan, observation
        recorder.observation(observation)
        state.map_failed = update is None
        update = update or _UNTRAINED
        recorder.step(step, result, observation.pose, update, watch.ms)
        on_step(StepReport(step, observation, plan, update, state.loop_s))
        if state.map_failed:
            return outcome(StopReason.MAP_ERROR)
        if state.monitor.fault is not None:
            _logger.error("%s; the run ends at step %d.", state.monitor.fault, step)
            return outcome(StopReason.SENSOR_FAULT)
        if result.fault is not None:
            _logger.error("the robot can drive no more (%s); the run ends at step %d.", result.fault, step)
            return outcome(result.fault)
        if state.collisions >= STUCK_COLLISIONS:
            return outcome(StopReason.STUCK)

    return outcome(StopReason.BUDGET)


def _observe(robot: Robot) -> Observation | None:
    """The next frame; None where the camera fails, whatever its driver raises then."""
    try:
        return robot.observe()
    except Exception as err:
        _logger.error("The camera failed (%s: %s); the run ends.", type(err).__name__, err)
        return None


def _coming_actions(follower: Follower, pose: Pose2, done: Action | None) -> list[Action]:
    """The next two actions from a pose, as far as they can be told; for who begins with what will be seen after them.

    Where a path ends, a decision follows, and most begin with what the robot did last (``done``; None = no guess): to
    go on, or to turn on. A pose that is not finite says nothing; the monitor tells of it.
    """
    if not all(map(math.isfinite, (pose.x_m, pose.y_m, pose.yaw_rad))):
        return []
    coming = follower.coming_actions(pose, 2)
    if len(coming) < 2 and done is not None:
        coming.append(coming[-1] if coming else done)
    return coming


def _learn(observation: Observation, mapper: Mapper, policy: Policy, watch: Stopwatch) -> MapUpdate | None:
    """Take a frame into the map, and tell the policy; None where the map cannot be trained any further."""
    try:
        with watch.stage("map"):
            update = mapper.integrate(observation)
    except MapError as err:
        _logger.error("%s The run ends.", err)
        return None
    with watch.stage("plan"):
        policy.observe(observation)
    return update


def _is_blocked(
    action: Action | None, plan: Plan | None, robot: Robot, mapper: Mapper, observation: Observation
) -> bool:
    """Whether the map now shows an obstacle on the planned path; fixed actions are executed without a check."""
    if action is not Action.MOVE_FORWARD or plan is None or plan.actions:
        return False
    grid = mapper.occupancy_about(observation.pose.xy_m, lookahead_radius_m(robot.footprint))
    return path_is_blocked(grid, robot.footprint, observation.pose)
