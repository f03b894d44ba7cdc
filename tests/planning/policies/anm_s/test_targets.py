import numpy as np

from anm_mj.planning.policies.anm_s.anm_s_config import AnmSConfig
from anm_mj.planning.policies.anm_s.targets import Targets
from anm_mj.types import Pose2

HERE, THERE = Pose2(0.0, 0.0, 0.0), np.array([3.0, 0.0])


def targets_after(*events):
    targets = Targets(AnmSConfig(max_fails=2, max_changes=3, same_target_m=1.0, fail_radius_m=0.3))
    for event in events:
        targets.choose(THERE, (), unvisited=True)
        if event == "fail":
            targets.fail()
        else:
            targets.drop_for(np.array(event, float), HERE)
    return targets


def is_given_up(targets):
    return bool(targets.is_given_up(THERE[None])[0])


def test_two_failures_give_a_target_up():
    assert not is_given_up(targets_after("fail"))
    assert is_given_up(targets_after("fail", "fail"))


def test_three_changes_give_a_target_up():
    assert not is_given_up(targets_after((0, 3), (0, 3)))
    assert is_given_up(targets_after((0, 3), (0, 3), (0, 3)))


def test_a_new_target_beside_the_present_one_is_no_change():
    assert not is_given_up(targets_after(*[(3.5, 0.5)] * 3))


def test_a_target_that_was_reached_is_not_dropped():
    targets = targets_after()
    for _ in range(3):
        targets.choose(THERE, (), unvisited=True)
        targets.drop_for(np.array([0.0, 3.0]), Pose2(2.9, 0.0, 0.0))
    assert not is_given_up(targets)


def test_the_nearest_place_stands_for_the_target():
    targets = targets_after((0, 3))
    assert targets.match(np.array([[3.5, 0.0], [3.1, 0.0]])).tolist() == [1]
    assert targets.match(np.array([[4.5, 0.0]])).tolist() == []
    targets.clear()
    assert targets.match(np.array([[3.1, 0.0]])).tolist() == []
