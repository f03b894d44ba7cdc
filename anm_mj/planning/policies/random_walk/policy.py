"""The baseline without any intention: uniform over forward, left and right (Yan et al., ICCV 2023, table 1)."""

from __future__ import annotations

import numpy as np

from anm_mj.planning.config import PlanningConfig
from anm_mj.protocols import Mapper
from anm_mj.types import Action, Footprint, Observation, Plan, Pose2

MOVES = (Action.MOVE_FORWARD, Action.TURN_LEFT, Action.TURN_RIGHT)


class RandomWalk:
    """Draws every action anew; a blocked move costs its step and changes nothing."""

    def __init__(self, config: PlanningConfig, footprint: Footprint, seed: int):
        """Only the seed matters; the rest is what every policy is made with."""
        del config, footprint  # A random walk has no settings and no body.
        self._rng = np.random.default_rng(seed)

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """One random action."""
        del mapper, observation  # A random walk does not look.
        action = MOVES[self._rng.integers(len(MOVES))]
        return Plan(f"random draw: {action.name}", np.zeros((0, 2)), actions=(action,))

    def blocked(self, pose: Pose2, action: Action) -> None:
        """Nothing is learnt from an obstacle."""
