"""Wrappers that make an environment easier to learn: small observations, actions that last, and a cost of nearness."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from jaxtyping import Float32, Int8

from anm_mj.environments.local_map import CELLS
from anm_mj.errors import TaskError
from anm_mj.mapping.mapping_config import OccupancyConfig
from anm_mj.types import OCCUPIED, UNKNOWN

RANGE_M = 4.7
"""How far a direction reaches; the map ends 4.8 m from the robot [m]."""


class RepeatAction(gymnasium.Wrapper):
    """Executes every action several times, up to a collision or the end; rewards, and the ``cost`` in ``info``, add up.

    A step of 6.5 cm or 10 degrees changes little: an agent that draws every step at random stays where it is.
    """

    def __init__(self, env: gymnasium.Env, times: int) -> None:
        """Wrap an environment with ``collided`` in its ``info``; 1 time changes nothing. Raises TaskError for less than
        one execution.
        """
        if times < 1:
            raise TaskError(f"times is {times}; an action is executed at least once.")
        super().__init__(env)
        self._times = times

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Execute an action; observation and all else in ``info`` are the last ones."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        total, cost = float(reward), info.get("cost", 0.0)
        for _ in range(self._times - 1):
            if terminated or truncated or info["collided"]:
                break
            observation, reward, terminated, truncated, info = self.env.step(action)
            total += float(reward)
            cost += info.get("cost", 0.0)
        return observation, total, terminated, truncated, {**info, "cost": cost} if "cost" in info else info


class KeepDistance(gymnasium.Wrapper):
    """Takes from the reward where people are near: nothing at ``within_m``, ``weight`` at contact, linear between."""

    def __init__(self, env: gymnasium.Env, within_m: float, weight: float) -> None:
        """Wrap an environment with ``people_m`` in its ``info``. Raises TaskError if the distance is not positive."""
        if not within_m > 0.0:
            raise TaskError(f"within_m is {within_m:g}; give a distance above 0 m.")
        super().__init__(env)
        self._within_m, self._weight = within_m, weight

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Execute an action; ``info["cost"]`` is what its reward went without."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        cost = self._weight * float(np.clip(1.0 - info["people_m"] / self._within_m, 0.0, 1.0))
        return observation, float(reward) - cost, terminated, truncated, {**info, "cost": cost}


class Directions(gymnasium.ObservationWrapper):
    """What the top-down map says in some directions, in place of the images: few numbers, quickly learnt.

    Observations are (3, n) float32 in [0, 1], column k in the direction k / n of a turn to the left of straight ahead:
    the distance to the nearest obstacle, the distance to the nearest unknown cell, and the length of unknown way before
    the obstacle, all over ``RANGE_M``.
    """

    def __init__(self, env: gymnasium.Env, num_directions: int = 24) -> None:
        """Wrap an environment that was made with ``topdown=True``. Raises TaskError if there is no top-down map among
        its observations.
        """
        names = list(env.observation_space) if isinstance(env.observation_space, spaces.Dict) else []
        if "topdown" not in names:
            raise TaskError("Directions needs the top-down map; make the environment with topdown=True.")
        super().__init__(env)
        edge_m = OccupancyConfig().voxel_m
        self._ahead_m = np.arange(edge_m, RANGE_M, edge_m)
        angle = np.arange(num_directions) * 2.0 * np.pi / num_directions
        # Row 0 is the farthest ahead, column 0 the farthest to the left.
        self._row, self._col = (
            np.floor(CELLS / 2 - np.outer(one, self._ahead_m) / edge_m).astype(np.int64)
            for one in (np.cos(angle), np.sin(angle))
        )
        self.observation_space = spaces.Box(0.0, 1.0, (3, num_directions), np.float32)

    def observation(self, observation: dict[str, np.ndarray]) -> Float32[np.ndarray, "3 n"]:
        """The directions of an observation."""
        topdown: Int8[np.ndarray, "rows cols"] = observation["topdown"]
        seen = topdown[self._row, self._col]
        obstacle_m, unknown_m = self._nearest_m(seen == OCCUPIED), self._nearest_m(seen == UNKNOWN)
        before = (seen == UNKNOWN) & (self._ahead_m < obstacle_m[:, None])
        return np.stack([obstacle_m / RANGE_M, unknown_m / RANGE_M, before.mean(axis=1)]).astype(np.float32)

    def _nearest_m(self, there: np.ndarray) -> np.ndarray:
        return np.where(there.any(axis=1), self._ahead_m[there.argmax(axis=1)], RANGE_M)
