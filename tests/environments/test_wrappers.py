"""The wrappers, around an environment whose answers are known."""

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces

from anm_mj.environments.wrappers import RANGE_M, Directions, KeepDistance, RepeatAction
from anm_mj.errors import TaskError
from anm_mj.types import FREE, OCCUPIED, UNKNOWN


class Corridor(gymnasium.Env):
    """Pays 1 per step; collides at the fifth, ends at the seventh."""

    action_space = spaces.Discrete(3)
    observation_space = spaces.Dict({"topdown": spaces.Box(UNKNOWN, OCCUPIED, (192, 192), np.int8)})

    def __init__(self):
        self.topdown = np.full((192, 192), FREE, np.int8)

    def reset(self, *, seed=None, options=None):
        self.steps = 0
        return {"topdown": self.topdown}, {}

    def step(self, action):
        self.steps += 1
        info = {"collided": self.steps == 5, "people_m": 0.25 * self.steps}
        return {"topdown": self.topdown}, 1.0, False, self.steps == 7, info


def test_an_action_is_repeated_up_to_a_collision_or_the_end():
    env = RepeatAction(Corridor(), times=4)
    env.reset()
    assert [env.step(0)[1:4] for _ in range(3)] == [(4.0, False, False), (1.0, False, False), (2.0, False, True)]


def test_costs_of_a_repeated_action_add_up_as_its_rewards_do():
    env = RepeatAction(KeepDistance(Corridor(), within_m=1.0, weight=2.0), times=3)
    env.reset()
    _, reward, _, _, info = env.step(0)
    assert info["cost"] == pytest.approx(2.0 * (0.75 + 0.5 + 0.25))
    assert reward == pytest.approx(3.0 - info["cost"])
    assert "cost" not in RepeatAction(env.unwrapped, times=1).step(0)[4]


def test_directions_are_those_of_the_map():
    corridor = Corridor()
    corridor.topdown[:76] = OCCUPIED  # a wall 1 m ahead
    corridor.topdown[:, :56] = UNKNOWN  # 2 m to the left nothing was observed
    env = Directions(corridor, num_directions=4)
    ahead, left, behind, right = env.reset()[0].T * [RANGE_M, RANGE_M, 1.0]
    np.testing.assert_allclose(ahead, [1.0, RANGE_M, 0.0], atol=0.06)
    np.testing.assert_allclose(left, [RANGE_M, 2.0, (RANGE_M - 2.0) / RANGE_M], atol=0.06)
    for free in (behind, right):
        np.testing.assert_allclose(free, [RANGE_M, RANGE_M, 0.0], atol=1e-6)
    assert env.observation_space.contains(env.reset()[0])


def test_unknown_way_is_measured_over_the_range_and_not_over_the_way():
    corridor = Corridor()
    corridor.topdown[:76] = OCCUPIED  # a wall 1 m ahead
    corridor.topdown[76:86] = UNKNOWN  # the half metre before it was not observed
    env = Directions(corridor, num_directions=4)
    np.testing.assert_allclose(env.reset()[0][:, 0] * RANGE_M, [1.0, 0.5, 0.5], atol=0.06)
    assert "length of unknown way" in str(Directions.__doc__)


def test_a_missing_map_and_no_execution_are_refused():
    images = Corridor()
    images.observation_space = spaces.Dict({"rgb": spaces.Box(0, 255, (4, 4, 3), np.uint8)})
    with pytest.raises(TaskError, match="topdown=True"):
        Directions(images)
    with pytest.raises(TaskError, match="times is 0"):
        RepeatAction(Corridor(), times=0)
