import itertools
import math

import numpy as np
import pytest

from anm_mj.control.action_motion import action_motion
from anm_mj.control.path_follower import Follower
from anm_mj.frames import move_pose, wrap_angle
from anm_mj.types import Action, Plan, Pose2


def follow(plan, pose, limit=500):
    follower = Follower()
    follower.start(plan)
    actions, poses = [], [pose]
    while (action := follower.next_action(pose)) is not None and len(actions) < limit:
        pose = move_pose(pose, *action_motion(action))
        actions.append(action)
        poses.append(pose)
    return actions, poses


@pytest.mark.parametrize("yaw_deg", range(-180, 180, 37))
def test_following_a_path_with_corners(yaw_deg):
    path = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.5], [0.5, 2.5]])
    actions, poses = follow(Plan("", path), Pose2(0.0, 0.0, math.radians(yaw_deg)))
    assert math.dist((poses[-1].x_m, poses[-1].y_m), path[-1]) < 0.1
    for pose in poses:
        along = np.clip(
            [np.dot(pose.xy_m - a, b - a) / np.dot(b - a, b - a) for a, b in itertools.pairwise(path)],
            0, 1,
        )  # fmt: skip
        nearest = min(
            np.linalg.norm(a + t * (b - a) - pose.xy_m) for a, b, t in zip(path[:-1], path[1:], along, strict=True)
        )
        assert nearest < 0.18
    turns = sum(action is not Action.MOVE_FORWARD for action in actions)
    assert turns < 18 + 9 + 7 + 25  # The start, the two corners, and what 10-degree steps cost on the way.


def test_no_alternating_turns():
    path = np.array([[0.0, 0.0], [3.0, 1.1]])
    actions, _ = follow(Plan("", path), Pose2(0.0, 0.0, 1.0))
    for a, b in itertools.pairwise(actions):
        assert {a, b} != {Action.TURN_LEFT, Action.TURN_RIGHT}


def test_headings_after_arrival():
    plan = Plan("", np.array([[0.0, 0.0], [0.5, 0.0]]), headings_rad=(math.pi / 2, -math.pi / 4))
    actions, poses = follow(plan, Pose2(0.0, 0.0, 0.0))
    first_turn = next(i for i, a in enumerate(actions) if a is not Action.MOVE_FORWARD)
    assert all(a is not Action.MOVE_FORWARD for a in actions[first_turn:])
    assert max(pose.yaw_rad for pose in poses) == pytest.approx(math.pi / 2, abs=0.1)
    assert wrap_angle(poses[-1].yaw_rad + math.pi / 4) == pytest.approx(0.0, abs=0.1)


def test_fixed_actions():
    plan = Plan("", np.zeros((0, 2)), actions=(Action.TURN_LEFT, Action.MOVE_FORWARD))
    assert follow(plan, Pose2(0.0, 0.0, 0.0))[0] == [Action.TURN_LEFT, Action.MOVE_FORWARD]


def test_end_of_a_plan():
    plan = Plan("", np.array([[0.0, 0.0], [5.0, 0.0]]), valid_steps=3)
    assert len(follow(plan, Pose2(0.0, 0.0, 0.0))[0]) == 3
    follower = Follower()
    follower.start(plan)
    follower.drop()
    assert follower.next_action(Pose2(0.0, 0.0, 0.0)) is None


def test_coming_actions_are_the_next_ones_and_change_nothing():
    path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.6]])
    none = np.zeros((0, 2))
    plans = [
        Plan("", path, headings_rad=(2.0, -1.0)),
        Plan("", none, actions=(Action.TURN_LEFT,) * 2),
        Plan("", path, valid_steps=3),
    ]
    for plan in plans:
        follower, pose = Follower(), Pose2(0.0, 0.0, 0.4)
        assert follower.coming_actions(pose, 2) == []
        follower.start(plan)
        every = follower.coming_actions(pose, 60)
        assert 2 <= len(every) < 60
        assert follower.coming_actions(pose, 60) == every
        for count, action in enumerate(every):
            assert follower.coming_actions(pose, 2) == every[count : count + 2]
            assert follower.next_action(pose) == action
            pose = move_pose(pose, *action_motion(action))
        assert follower.next_action(pose) is None
