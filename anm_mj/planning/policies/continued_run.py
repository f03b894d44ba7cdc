"""What policies need to begin with what a prior run explored."""

import numpy as np
from jaxtyping import Float

from anm_mj.errors import PlanError
from anm_mj.planning.field_of_view import turns_to_look_around
from anm_mj.protocols import Mapper, Policy
from anm_mj.types import Action, ExploredState, Observation, Plan, Pose2, StopReason

KNOWN_PLACE_M = 1.0
"""The surroundings of a place are known where a prior run was within this of it [m]."""


def is_known_place(prior_poses: Float[np.ndarray, "n 3"], observation: Observation) -> bool:
    """Whether a robot stands where a prior run was, so that it need not look around first."""
    away = np.linalg.norm(prior_poses[:, :2] - observation.pose.xy_m, axis=1)
    return bool((away <= KNOWN_PLACE_M).any())


def remembered(prior: ExploredState, name: str, shape: tuple[int | None, ...]) -> np.ndarray | None:
    """An array of numbers that a policy remembered; None where it did not. Raises PlanError if it has another shape, in
    which None stands for any length.
    """
    array = prior.memory.get(name)
    if array is None:
        return None
    fits = array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))
    if not fits or array.dtype.kind not in "fiu" or np.isinf(array).any():
        raise PlanError(f"The prior run remembers {name!r} with shape {array.shape}, not {shape}; explore again.")
    return array


class LookingAround:
    """A policy of a continued run: where there is nothing to do, the robot looks around once before it ends."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self._is_first = True

    def observe(self, observation: Observation) -> None:
        """Pass an observation on."""
        self._policy.observe(observation)

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """The policy's decision; a panorama instead of an end where it is the first one."""
        plan = self._policy.plan(mapper, observation)
        is_first, self._is_first = self._is_first, False
        ends = plan.stop in (StopReason.COMPLETE, StopReason.NO_REACHABLE_TARGET)
        if not ends or not is_first:
            return plan
        turns = turns_to_look_around(observation)
        reason = f"a look around, because the prior run left nothing to explore ({plan.reason})"
        return Plan(reason, actions=(Action.TURN_LEFT,) * turns)

    def on_collision(self, pose: Pose2, action: Action) -> None:
        """Pass a collision on."""
        self._policy.on_collision(pose, action)
