"""The loop: observe, learn, decide, act, until the budget is spent or nothing is left to see. Start reading here.

scene -> simulator -> observation -> neural map -> top-down map -> graph -> regions -> target -> path -> discrete
actions -> wheel commands -> (again). The loop sees the stages through :mod:`anm_mj.protocols` only, and tells observers
what happens (:mod:`anm_mj.events`). Each stage can be replaced: by a real robot, another map, another policy.
"""

import logging
from collections.abc import Sequence

from anm_mj import loop_stages as stages
from anm_mj.errors import PlanError
from anm_mj.events import Decided, Ended, Event, Located, Observed, Observer, Stepped
from anm_mj.localisation.localiser import Localiser
from anm_mj.loop_state import LoopState
from anm_mj.protocols import Mapper, Policy, Robot
from anm_mj.types import Action, StopReason
from anm_mj.utils.stopwatch import Stopwatch

_logger = logging.getLogger(__name__)

STUCK_COLLISIONS = 12
"""A robot that collides this often on its path, without a free step in between, is stuck."""


def explore(
    robot: Robot,
    mapper: Mapper,
    policy: Policy,
    *,
    num_steps: int,
    localiser: Localiser | None = None,
    observers: Sequence[Observer] = (),
    state: LoopState | None = None,
) -> Ended:
    """Explore until a ``StopReason`` comes up.

    Args:
        robot: observes once before the first action and once after every action.
        mapper: learns from every observation whose pose is good enough.
        policy: hears what the mapper learns from, and plans whenever the last plan is done, outdated or blocked.
        num_steps: budget of discrete actions; turns and collisions count.
        localiser: estimates the pose of every observation; None = poses are taken as they come.
        observers: hear every event in this order; any of them may end the run.
        state: where an earlier call stood, to go on from there with the robot, mapper and policy of then; None = at the
            start. It is kept up to date.

    Raises:
        PlanError: the policy returned a plan that asks for nothing.
    """
    state = state or LoopState()

    def tell(event: Event) -> bool:
        """Whether an observer wants the run to end; all hear the event."""
        return any([observer.on_event(event) for observer in observers])

    def end(reason: StopReason) -> Ended:
        assert state.observation is not None
        ended = Ended(reason, state.step, state.loop_s, state.observation)
        tell(ended)
        return ended

    interrupted = False
    if state.observation is None:
        with state.total.stage("observe"):
            first = state.monitor.check(robot.observe())
        first, estimate = stages.localise(first, localiser, state, state.total)
        first, estimate = stages.find_moved(first, estimate, mapper)
        update = stages.learn(first, estimate, localiser, mapper, policy, state.total)
        state.map_failed, state.observation = update is None, first
        interrupted = tell(Observed(first, update or stages.UNTRAINED, estimate))
    if state.map_failed:
        return end(StopReason.MAP_ERROR)

    for step in range(state.step + 1, num_steps + 1):
        if interrupted:
            return end(StopReason.INTERRUPTED)
        watch, observation = Stopwatch(), state.observation
        with watch.stage("plan"):
            action, plan, decided = stages.decide(robot, mapper, policy, state)
        if decided:
            interrupted = tell(Decided(step - 1, plan))
        if plan.stop is not None:
            state.total.add(watch)
            # What a blind robot says about its surroundings means nothing.
            return end(StopReason.SENSOR_FAULT if state.monitor.is_blind else plan.stop)
        if action is None:
            raise PlanError(f"The policy's plan at step {step} ('{plan.reason}') holds neither an action nor a stop.")

        with watch.stage("act"):
            result = robot.act(action)
        if result.collided:
            policy.on_collision(observation.pose, action)
            state.follower.drop()
            state.collisions += not plan.actions
        elif action is Action.MOVE_FORWARD:
            state.collisions = state.blind_turns = 0
        with watch.stage("observe"):
            moved = not result.collided and action is not Action.WAIT
            seen = stages.observe(robot, mapper, state, action, moved=moved, judges_pose=localiser is None)
        if seen is None:
            state.total.add(watch)
            state.step = step
            return end(StopReason.SENSOR_FAULT)
        seen, estimate = stages.localise(seen, localiser, state, watch)
        with watch.stage("map"):
            seen, estimate = stages.find_moved(seen, estimate, mapper)
        state.things.update(seen)
        interrupted |= tell(Located(seen))
        update = stages.learn(seen, estimate, localiser, mapper, policy, watch)
        state.total.add(watch)
        state.step, state.plan, state.observation, state.map_failed = step, plan, seen, update is None
        update = update or stages.UNTRAINED
        interrupted |= tell(Observed(seen, update, estimate))
        interrupted |= tell(Stepped(step, result, seen, update, plan, mapper, watch.ms, state.loop_s))
        if state.map_failed:
            return end(StopReason.MAP_ERROR)
        if state.monitor.fault is not None:
            _logger.error("%s; the run ends at step %d.", state.monitor.fault, step)
            return end(StopReason.SENSOR_FAULT)
        if result.fault is not None:
            _logger.error("the robot can drive no more (%s); the run ends at step %d.", result.fault, step)
            return end(result.fault)
        if state.collisions >= STUCK_COLLISIONS:
            return end(StopReason.STUCK)
    return end(StopReason.BUDGET)
