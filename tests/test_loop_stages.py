"""What a policy hears of."""

from dataclasses import replace
from functools import partial
from typing import Protocol
from unittest.mock import Mock

import numpy as np
import pytest

from anm_mj.localisation.localiser import Localiser, PoseEstimate, RegistrationQuality, TrackingState
from anm_mj.loop_stages import doubt_stop, give_way, learn
from anm_mj.loop_state import LoopState
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.policies.return_to_start import ReturnToStart
from anm_mj.protocols import FindsMoved, Mapper, Policy, Robot
from anm_mj.sensing.moving_things import MovingThing
from anm_mj.types import Action, Footprint, MapUpdate, Plan, Pose2, StopReason
from anm_mj.utils.stopwatch import Stopwatch
from tests.box_room import observe


@pytest.mark.parametrize("usable", [True, False])
def test_a_policy_hears_of_what_enters_the_map(usable):
    seen = observe(0, Pose2(0.0, 0.0, 0.0))
    quality = RegistrationQuality(1.0, 1.0, 3)
    estimate = PoseEstimate(seen, np.eye(6), quality, TrackingState.TRACKING, usable)
    localiser = Mock(spec=Localiser, integrate=Mock(return_value=MapUpdate(0.0, 1, 1)))
    policy = Mock(spec=Policy)

    learn(seen, estimate, localiser, Mock(spec=Mapper), policy, Stopwatch())

    assert policy.observe.called == localiser.integrate.called == usable


class FindingMapper(Mapper, FindsMoved, Protocol):
    """A map that finds what moves."""


AHEAD = MovingThing(0.6, 0.0, (-0.3, 0.0), 0.25, 0.0)


def state_before(*things: MovingThing) -> LoopState:
    state = LoopState(patience_steps=3)
    state.observation = observe(0, Pose2(0.0, 0.0, 0.0))
    state.things.things = list(things)
    return state


@pytest.mark.parametrize("velocity_mps", [(-0.3, 0.0), (0.0, 0.0)])
def test_a_robot_waits_patiently_and_then_takes_what_moves_or_stands_for_an_obstacle(velocity_mps):
    robot, mapper, state = (
        Mock(spec=Robot, footprint=Footprint(0.18, 0.05, 1.35)),
        Mock(spec=FindingMapper),
        state_before(replace(AHEAD, velocity_mps=velocity_mps)),
    )
    state.follower.start(Plan("", np.array([[0.0, 0.0], [3.0, 0.0]])))

    done = [give_way(Action.MOVE_FORWARD, robot, mapper, state) for _ in range(2)]
    assert done == [Action.WAIT, Action.WAIT]
    assert not mapper.hold_moved.called
    assert give_way(Action.MOVE_FORWARD, robot, mapper, state) is Action.WAIT
    assert mapper.hold_moved.called
    assert state.follower.next_action(Pose2(0.0, 0.0, 0.0)) is None

    state.things.things = []
    assert give_way(Action.MOVE_FORWARD, robot, mapper, state) is Action.MOVE_FORWARD
    assert state.waited == 0


def test_a_fixed_action_that_a_wait_puts_off_comes_again():
    robot, mapper = Mock(spec=Robot, footprint=Footprint(0.18, 0.05, 1.35)), Mock(spec=FindingMapper)
    state, here = state_before(AHEAD), Pose2(0.0, 0.0, 0.0)
    state.follower.start(Plan("", np.zeros((0, 2)), actions=(Action.MOVE_FORWARD, Action.TURN_LEFT)))

    wanted = state.follower.next_action(here)
    assert give_way(wanted, robot, mapper, state) is Action.WAIT
    state.things.things = []
    wanted = state.follower.next_action(here)
    assert give_way(wanted, robot, mapper, state) is Action.MOVE_FORWARD
    assert state.follower.next_action(here) is Action.TURN_LEFT


def test_a_robot_turns_whoever_is_near():
    assert (
        give_way(Action.TURN_LEFT, Mock(spec=Robot), Mock(spec=FindingMapper), state_before(AHEAD)) is Action.TURN_LEFT
    )


@pytest.mark.parametrize("stop", [StopReason.COMPLETE, StopReason.NO_REACHABLE_TARGET])
def test_a_run_does_not_end_because_somebody_stands_there_nor_wait_for_ever(stop):
    state, mapper = (
        state_before(AHEAD),
        Mock(spec=FindingMapper, release_moved=Mock(return_value=False), doubt_moved=Mock(return_value=False)),
    )
    decisions = [doubt_stop(Plan("done", stop=stop), mapper, state) for _ in range(5)]

    assert [plan.stop for plan in decisions] == [None, None, None, stop, stop]
    assert all(plan.actions == (Action.WAIT,) for plan in decisions[:3])


def test_the_drive_home_does_not_begin_because_somebody_stands_there():
    state, mapper = state_before(AHEAD), Mock(spec=FindingMapper, release_moved=Mock(return_value=False))
    mapper.doubt_moved.return_value = False
    explorer = Mock(spec=Policy, plan=Mock(return_value=Plan("done", stop=StopReason.COMPLETE)))
    policy = ReturnToStart(explorer, PlanningConfig(), Footprint(0.18, 0.05, 1.35), 1000)
    policy.confirm = partial(doubt_stop, state=state)
    policy.observe(state.observation)
    # The loop doubts the plan once more, which must not forget how often it was put off.
    for _ in range(3):
        assert doubt_stop(policy.plan(mapper, state.observation), mapper, state).actions == (Action.WAIT,)
        assert policy.explored_steps is None
    assert policy.plan(mapper, state.observation).stop is StopReason.COMPLETE
    assert policy.explored_steps == 0


def test_a_run_ends_where_nothing_moves_or_an_error_ends_it():
    nothing = Mock(return_value=False)
    mapper = Mock(spec=FindingMapper, release_moved=nothing, doubt_moved=nothing)
    complete, error = Plan("done", stop=StopReason.COMPLETE), Plan("oh", stop=StopReason.POLICY_ERROR)

    assert doubt_stop(complete, mapper, state_before()) is complete
    assert doubt_stop(error, mapper, state_before(AHEAD)) is error


def test_a_run_does_not_end_before_what_may_be_left_of_a_thing_was_doubted():
    doubts = Mock(side_effect=[True, False])
    mapper = Mock(spec=FindingMapper, release_moved=Mock(return_value=False), doubt_moved=doubts)
    state, complete = state_before(), Plan("done", stop=StopReason.COMPLETE)

    doubted, ended = (doubt_stop(complete, mapper, state) for _ in range(2))

    assert (doubted.stop, doubted.actions) == (None, (Action.WAIT,))
    assert ended is complete
