"""The random baseline: uniform over forward, left and right (Yan et al., ICCV 2023, table 1)."""

import numpy as np

from anm_mj.planning.policies.context import PolicyConfig, PolicyContext
from anm_mj.protocols import Mapper
from anm_mj.types import Action, Observation, Plan, Pose2

MOVES = (Action.MOVE_FORWARD, Action.TURN_LEFT, Action.TURN_RIGHT)


class RandomWalk:
    """Draws a new action at every step; a collision costs a step and changes nothing."""

    def __init__(self, context: PolicyContext[PolicyConfig]):
        self._rng = np.random.default_rng(context.seed)

    def observe(self, observation: Observation) -> None:
        """Learn nothing from what the robot sees."""

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """One random action."""
        del mapper, observation  # A random walk does not look.
        action = MOVES[self._rng.integers(len(MOVES))]
        return Plan(f"random draw: {action.name}", actions=(action,))

    def on_collision(self, pose: Pose2, action: Action) -> None:
        """Learn nothing from an obstacle."""
