"""A robot that grows unsure of its pose goes back to where it was sure."""

import math
from dataclasses import replace

import pytest

from anm_mj.control.action_motion import action_motion
from anm_mj.control.path_follower import Follower
from anm_mj.frames import move_pose, wrap_angle
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.policies.return_to_certainty import MOST_PLANS, ReturnToCertainty
from anm_mj.types import ARRIVED_M, TURN_STEP_RAD, Action, Plan, Pose2
from tests.box_room import observe
from tests.planning.worlds import room

MAPPER = room(4, 3)
SURE_M, UNSURE_M = 0.01, 0.03


class Explores:
    """Notes what it is asked for."""

    def __init__(self):
        self.seen, self.asked = [], []

    def observe(self, observation):
        self.seen.append(observation.step)

    def plan(self, mapper, observation):
        self.asked.append(observation.step)
        return Plan("on", actions=(Action.TURN_LEFT,))

    def on_collision(self, pose, action): ...


def view(step, x, yaw=0.0, deviation_m=SURE_M, deviation_rad=0.0):
    seen = observe(step, Pose2(x, 1.0, yaw))
    return replace(seen, position_deviation_m=deviation_m, heading_deviation_rad=deviation_rad)


@pytest.fixture
def policy():
    made = ReturnToCertainty(Explores(), PlanningConfig())
    made.observe(view(0, 1.0, yaw=0.5))
    return made


def walk(policy, deviation_m=UNSURE_M):
    """Three steps on, with a growing uncertainty; the last view."""
    for step in (1, 2, 3):
        seen = view(step, 1.0 + 0.1 * step, deviation_m=step / 3 * deviation_m)
        policy.observe(seen)
    return seen


def test_a_sure_robot_explores(policy):
    assert policy.plan(MAPPER, walk(policy, deviation_m=0.02)).reason == "on"


def test_an_unsure_robot_goes_back_along_its_trail(policy):
    plan = policy.plan(MAPPER, walk(policy))

    # The first step left it sure enough.
    assert plan.path_xy_m[:, 0] == pytest.approx([1.3, 1.2, 1.1])
    assert plan.headings_rad == (0.0,)
    assert "its standard deviations are 3.0 cm and 0.0 degrees" in plan.reason


@pytest.mark.parametrize("steps", [5, 20])
def test_it_arrives_where_it_was_sure(policy, steps):
    """Unsure as it stays, it drives back along a bent way with the actions of the loop."""
    pose, follower = Pose2(1.0, 1.0, 0.5), Follower()
    for step in range(1, steps + 1):
        pose = move_pose(pose, *action_motion(Action.TURN_LEFT if step % 5 == 4 else Action.MOVE_FORWARD))
        seen = view(step, pose.x_m, pose.yaw_rad, 0.014 if step < steps else UNSURE_M)
        policy.observe(replace(seen, pose=pose))
    for step in range(steps, steps + 90):
        action = follower.next_action(pose)
        if action is None:
            plan = policy.plan(MAPPER, replace(view(step, pose.x_m, deviation_m=UNSURE_M), pose=pose))
            if plan.reason == "on":
                break
            follower.start(plan)
            action = follower.next_action(pose)
        pose = move_pose(pose, *action_motion(action))
        policy.observe(replace(view(step + 1, pose.x_m, deviation_m=UNSURE_M), pose=pose))
    assert math.dist(pose.xy_m, (1.0, 1.0)) < ARRIVED_M
    assert abs(wrap_angle(pose.yaw_rad - 0.5)) < TURN_STEP_RAD


def test_a_robot_that_is_unsure_where_it_was_sure_does_not_go_back_again(policy):
    policy.plan(MAPPER, walk(policy))
    back = view(4, 1.1, deviation_m=UNSURE_M)
    policy.observe(back)
    assert policy.plan(MAPPER, back).reason == "on"
    # Its way from here on is none of the trail.
    far = view(30, 3.0, deviation_m=UNSURE_M)
    policy.observe(far)
    assert policy.plan(MAPPER, far).reason == "on"


def test_it_goes_back_until_it_is_sure(policy):
    policy.plan(MAPPER, walk(policy))

    better = view(4, 1.2, deviation_m=0.02)
    policy.observe(better)
    assert "return" in policy.plan(MAPPER, better).reason
    sure = view(5, 1.2)
    policy.observe(sure)
    assert policy.plan(MAPPER, sure).reason == "on"


def test_an_uncertain_heading_turns_back(policy):
    turned = view(1, 1.0, yaw=1.0, deviation_rad=0.02)

    plan = policy.plan(MAPPER, turned)

    assert len(plan.path_xy_m) == 0
    assert plan.headings_rad == (0.5,)


def test_where_nothing_is_left_to_do_it_explores(policy):
    unsure = view(1, 1.0, yaw=0.5, deviation_rad=0.02)

    assert policy.plan(MAPPER, unsure).reason == "on"


def test_it_does_not_go_back_for_ever(policy):
    last = walk(policy)

    reasons = [policy.plan(MAPPER, last).reason for _ in range(MOST_PLANS + 1)]

    assert all("return" in reason for reason in reasons[:-1])
    assert reasons[-1] == "on"


def test_a_collision_ends_the_return(policy):
    last = walk(policy)
    policy.plan(MAPPER, last)

    policy.on_collision(last.pose, Action.MOVE_FORWARD)

    assert policy.plan(MAPPER, last).reason == "on"


def test_a_collision_before_the_return_leaves_it(policy):
    """What the robot met while it explored lies ahead; it came along its trail."""
    policy.observe(view(1, 1.1, deviation_m=0.02))
    policy.on_collision(Pose2(1.1, 1.0, 0.0), Action.MOVE_FORWARD)
    unsure = view(2, 1.2, deviation_m=UNSURE_M)
    policy.observe(unsure)

    plan = policy.plan(MAPPER, unsure)

    assert plan.path_xy_m[:, 0] == pytest.approx([1.2, 1.1, 1.0])
    assert "return" in plan.reason


def test_exact_poses_change_nothing():
    explores = Explores()
    policy = ReturnToCertainty(explores, PlanningConfig())
    for step in range(3):
        seen = observe(step, Pose2(0.1 * step, 0.0, math.pi / 2))
        policy.observe(seen)
        policy.plan(MAPPER, seen)

    assert explores.seen == explores.asked == [0, 1, 2]
