"""What an action is worth to a learner: new surface, new area, or what the map gained."""

import numpy as np
from dm_env import specs

from anm_mj.environments.local_map import LocalMap


class Reward:
    """The growth, from view to view, of what is known.

    ``surface``: the newly covered fraction of the observable surface, in [0, 1]. ``area``: newly observed area of the
    top-down map [m2]. ``information``: what the occupancy grid gained [bits]; less than zero where a view contradicts
    it.
    """

    def __init__(self, kind: str, local_map: LocalMap | None) -> None:
        """Start an episode; ``kind`` is what counts, as ``EnvironmentConfig.reward`` says; ``surface`` needs no map."""
        self._kind = kind
        self._map = local_map
        self.known = 0.0
        """What is known so far, in the unit of the reward."""

    def of_view(self, new_surface: float) -> float:
        """The reward of a view that is in the map by now.

        ``new_surface`` is the fraction of the observable surface that it is the first to cover, in [0, 1].
        """
        before = self.known
        if self._map is None or self._kind == "surface":
            self.known += new_surface
            return new_surface
        self.known = self._map.area_m2 if self._kind == "area" else self._map.information_bits
        return self.known - before


def reward_spec(kind: str) -> specs.Array:
    """Bounds of a reward of one kind."""
    if kind == "surface":
        return specs.BoundedArray((), float, 0.0, 1.0, name="reward")
    if kind == "area":
        return specs.BoundedArray((), float, 0.0, np.inf, name="reward")
    return specs.Array((), float, name="reward")
