import math
from dataclasses import replace

import numpy as np
import pytest

from anm_mj.anticipating_robot import AnticipatingRobot
from anm_mj.errors import MapError, PlanError
from anm_mj.events import On, Stepped
from anm_mj.explore import STUCK_COLLISIONS, explore
from anm_mj.loop_state import LoopState
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.registry import default_settings, make_policy
from anm_mj.types import OCCUPIED, Action, Plan, Pose2, StopReason
from tests.fake_robot import FakeRobot, ListRecorder
from tests.planning.worlds import room


def run(policy, world, pose, num_steps=200, observers=()):
    robot, recorder = FakeRobot(world, pose), ListRecorder()
    outcome = explore(robot, world, policy, num_steps=num_steps, observers=(recorder, *observers))
    return outcome, recorder


def make(name, seed=0, **settings):
    settings = replace(default_settings(name), **settings)
    return make_policy(name, PolicyContext(FakeRobot.footprint, settings, seed=seed))


def seen_room(**options):
    """A room with floor and ceiling seen, of which only ``unknown`` is left to explore."""
    world = room(5, 4, **options)
    grid = world.occupancy
    grid.state[0] = grid.state[-1] = OCCUPIED
    grid.seen_range_m[0] = grid.seen_range_m[-1] = 1.0
    return world


class Scripted:
    def __init__(self, *plans):
        self.plans = list(plans)
        self.blocked_at = []

    def plan(self, mapper, observation):
        return self.plans.pop(0) if len(self.plans) > 1 else self.plans[0]

    def observe(self, observation):
        pass

    def on_collision(self, pose, action):
        self.blocked_at.append((pose, action))


def straight_to(x, y, start=(1.0, 1.5)):
    return Plan("straight", np.array([start, (x, y)], float))


def test_everything_is_recorded_in_the_order_it_happened():
    turns = Plan("turn", np.zeros((0, 2)), actions=(Action.TURN_LEFT,) * 3)
    outcome, recorder = run(Scripted(turns), seen_room(), Pose2(1.0, 1.5, 0.0), num_steps=7)
    assert outcome.stop_reason is StopReason.BUDGET
    assert outcome.num_steps == 7
    assert [observation.step for observation in recorder.observations] == list(range(8))
    assert [step for step, *_ in recorder.steps] == list(range(1, 8))
    assert [step for step, _ in recorder.plans] == [0, 3, 6]
    assert set(recorder.steps[0][3]) == {"plan", "act", "observe", "map"}
    assert outcome.loop_s > 0


class Anticipating(FakeRobot):
    """Loses its direction once, and notes what it is told to expect."""

    def __init__(self, world, pose):
        super().__init__(world, pose)
        self.expected = []

    def observe(self):
        seen = super().observe()
        return replace(seen, pose=replace(seen.pose, yaw_rad=math.inf)) if self.steps == 3 else seen

    def anticipate(self, *actions):
        self.expected.append(actions)


def test_a_robot_is_told_what_comes_next_only_from_a_pose_that_is_finite():
    robot, recorder = Anticipating(seen_room(), Pose2(1.0, 1.5, 0.0)), ListRecorder()
    policy = Scripted(straight_to(3.0, 1.5))
    state = LoopState()
    ahead = AnticipatingRobot(robot, state)
    outcome = explore(ahead, robot.world, policy, num_steps=6, observers=(ahead, recorder), state=state)
    assert outcome.num_steps == 6
    assert robot.steps == 6
    # Twice after each step, but not where nobody knows the pose, after step 3.
    ahead = (Action.MOVE_FORWARD,) * 2
    assert robot.expected.count(ahead) == 5
    assert robot.expected.count(ahead[:1]) == 5


def expected_images(plan, num_steps):
    robot = Anticipating(seen_room(), Pose2(1.0, 1.5, 0.0))
    state = LoopState()
    ahead = AnticipatingRobot(robot, state)
    explore(ahead, robot.world, Scripted(plan), num_steps=num_steps, observers=(ahead,), state=state)
    return robot.expected


def test_where_a_path_ends_the_last_action_is_expected_again_and_after_given_actions_none():
    # Before and after the map learns.
    assert expected_images(straight_to(1.1, 1.5), 1) == [(Action.MOVE_FORWARD,)] * 2
    turn = (Action.TURN_LEFT,)
    assert expected_images(Plan("turn", np.zeros((0, 2)), actions=turn * 2), 2) == [turn, turn, (), ()]


def test_a_request_to_stop_ends_the_run_as_interrupted():
    turns = Plan("turn", np.zeros((0, 2)), actions=(Action.TURN_LEFT,))
    stop = On(Stepped, lambda stepped: stepped.step == 2)
    outcome, recorder = run(Scripted(turns), seen_room(), Pose2(1.0, 1.5, 0.0), observers=(stop,))
    assert outcome.stop_reason is StopReason.INTERRUPTED
    assert outcome.num_steps == len(recorder.steps) == 2


def test_a_policy_is_told_of_obstacles_and_a_robot_that_never_gets_on_is_stuck():
    world = seen_room()
    world.boxes = np.concatenate([world.boxes, [[1.3, 1.0, 1.35, 2.0]]])  # The grid does not show this one.
    policy = Scripted(straight_to(3.0, 1.5))
    outcome, recorder = run(policy, world, Pose2(1.0, 1.5, 0.0))
    assert outcome.stop_reason is StopReason.STUCK
    assert len(policy.blocked_at) == STUCK_COLLISIONS
    assert all(action is Action.MOVE_FORWARD for _, action in policy.blocked_at)
    assert sum(result.collided for _, result, *_ in recorder.steps) == STUCK_COLLISIONS


def test_an_obstacle_that_shows_up_on_the_way_makes_the_policy_decide_again():
    world = seen_room()
    world.occupancy.state[:, 20:40, 44:46] = OCCUPIED
    turn = Plan("turn", np.zeros((0, 2)), actions=(Action.TURN_LEFT,))
    outcome, recorder = run(Scripted(straight_to(4.0, 1.5), turn), world, Pose2(1.0, 1.5, 0.0), num_steps=40)
    assert not any(result.collided for _, result, *_ in recorder.steps)
    assert max(pose.x_m for _, _, pose, _ in recorder.steps) < 2.2 - 0.18
    assert [plan.reason for _, plan in recorder.plans[:2]] == ["straight", "turn"]
    assert outcome.stop_reason is StopReason.BUDGET


def test_a_plan_that_asks_for_nothing_is_refused():
    with pytest.raises(PlanError, match="holds neither an action nor a stop"):
        run(Scripted(Plan("nothing", np.zeros((0, 2)))), seen_room(), Pose2(1.0, 1.5, 0.0))


@pytest.mark.parametrize("failing_frame", [0, 3])
def test_a_map_that_cannot_be_trained_any_further_ends_the_run_with_all_recorded(failing_frame, monkeypatch, caplog):
    world = seen_room()
    integrate = world.integrate

    def fail(observation):
        if observation.step == failing_frame:
            raise MapError("The training loss became nan.")
        return integrate(observation)

    monkeypatch.setattr(world, "integrate", fail, raising=False)
    turns = Plan("turn", np.zeros((0, 2)), actions=(Action.TURN_LEFT,))
    outcome, recorder = run(Scripted(turns), world, Pose2(1.0, 1.5, 0.0))
    assert outcome.stop_reason is StopReason.MAP_ERROR
    assert outcome.num_steps == len(recorder.steps) == failing_frame
    assert len(recorder.observations) == failing_frame + 1
    assert "The training loss became nan. The run ends." in caplog.text


def test_gvg_is_complete_in_a_room_that_is_known():
    outcome, recorder = run(make("gvg"), seen_room(), Pose2(1.0, 1.5, 0.0))
    assert outcome.stop_reason is StopReason.COMPLETE
    # The look around at the start, and nothing after it.
    assert outcome.num_steps == 27
    assert "best expected gain" in recorder.plans[-1][1].reason


def test_gvg_goes_where_the_unknown_is():
    world = seen_room(unknown=[(4.4, 0.2, 5.2, 4.2)])
    _, recorder = run(make("gvg", bootstrap_turns=0, gain_range_m=2.5), world, Pose2(1.0, 1.5, 0.0), num_steps=60)
    assert max(pose.x_m for _, _, pose, _ in recorder.steps) > 2.5
    assert not any(result.collided for _, result, *_ in recorder.steps)


def test_anm_s_looks_around_and_then_visits_vertices_without_collision():
    world = seen_room(boxes=[(2.2, 1.6, 2.6, 2.0)])
    outcome, recorder = run(make("anm-s", visited_by="place"), world, Pose2(1.0, 1.5, 0.0), num_steps=500)
    actions = [result.action for _, result, *_ in recorder.steps]
    assert set(actions[:36]) == {Action.TURN_LEFT}
    assert outcome.stop_reason is StopReason.COMPLETE
    assert not any(result.collided for _, result, *_ in recorder.steps)
    assert np.ptp([pose.x_m for _, _, pose, _ in recorder.steps]) > 1.5


def test_a_walled_in_robot_has_no_reachable_target():
    walls = [(0.7, 1.2, 0.8, 1.8), (1.2, 1.2, 1.3, 1.8), (0.7, 1.2, 1.3, 1.3), (0.7, 1.7, 1.3, 1.8)]
    outcome, _ = run(make("anm-s"), seen_room(boxes=walls), Pose2(1.0, 1.5, 0.0))
    assert outcome.stop_reason is StopReason.NO_REACHABLE_TARGET


def test_random_draws_the_same_actions_for_the_same_seed_and_others_for_another():
    def actions(seed):
        policy = make("random", seed)
        _, recorder = run(policy, seen_room(), Pose2(1.0, 1.5, 0.0), num_steps=60)
        return [result.action for _, result, *_ in recorder.steps]

    assert actions(3) == actions(3)
    assert actions(3) != actions(4)
    assert set(actions(3)) == {Action.MOVE_FORWARD, Action.TURN_LEFT, Action.TURN_RIGHT}


def test_gvg_weighing_few_places_still_goes_where_the_unknown_is():
    world = seen_room(unknown=[(4.4, 0.2, 5.2, 4.2)])
    policy = make("gvg", bootstrap_turns=0, gain_range_m=2.0, max_candidates=2)
    outcome, recorder = run(policy, world, Pose2(0.6, 0.6, 0.0), num_steps=60)
    assert outcome.stop_reason is StopReason.BUDGET
    assert max(pose.x_m for _, _, pose, _ in recorder.steps) > 2.3


@pytest.mark.parametrize(("name", "range_name"), [("gvg", "gain_range_m"), ("anm-s", "seen_well_m")])
def test_a_policy_gets_past_an_obstacle_that_the_map_does_not_show(name, range_name):
    world = seen_room(unknown=[(4.4, 0.2, 5.2, 4.2)])
    world.boxes = np.concatenate([world.boxes, [[2.2, 1.4, 2.25, 2.6]]])  # Across the straight way, unseen.
    world.sdf = lambda points: np.full(len(points), 0.1, np.float32)
    policy = make(name, bootstrap_turns=0, **{range_name: 2.5})
    outcome, recorder = run(policy, world, Pose2(1.2, 2.0, 0.0), num_steps=250)
    assert outcome.stop_reason is not StopReason.STUCK
    assert max(pose.x_m for _, _, pose, _ in recorder.steps) > 3.0
    assert 1 <= sum(result.collided for _, result, *_ in recorder.steps) <= 8
    # After a contact the robot drives on within half a turn: it never spins on the spot to find out where it is.
    after = [result for _, result, *_ in recorder.steps]
    after = after[[result.collided for result in after].index(True) :]
    turns = 0
    for result in after[:60]:
        turns = 0 if result.action is Action.MOVE_FORWARD else turns + 1
        assert turns <= 18


def test_vertices_passed_on_the_way_count_as_visited():
    policy = make("anm-s", bootstrap_turns=0, visited_by="place")
    _, recorder = run(policy, seen_room(boxes=[(2.2, 1.6, 2.6, 2.0)]), Pose2(1.0, 1.5, 0.0), num_steps=120)
    trajectory = np.array(policy.stages.topdown.trajectory_xy_m)
    driven = np.array([pose.xy_m for _, _, pose, _ in recorder.steps])
    last_plan = recorder.plans[-1][0]
    away = np.linalg.norm(driven[:last_plan, None] - trajectory[None], axis=-1).min(axis=1)
    assert away.max() < 0.3
