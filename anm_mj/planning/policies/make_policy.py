"""A policy by its name, for a body; with the settings that it has where nothing else is asked for."""

from typing import Any

from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.policies import registry
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.registry import DEFAULT_GOAL, DEFAULT_POLICY, default_settings
from anm_mj.protocols import Policy
from anm_mj.types import Footprint


def make_policy(
    name: str = DEFAULT_POLICY,
    *,
    footprint: Footprint,
    settings: Any = None,
    seed: int = 0,
    truth: object = None,
    goal: str = DEFAULT_GOAL,
) -> Policy:
    """A policy for a robot. Raises PlanError if there is no such policy, or it cannot be made.

    Args:
        name: name of a policy, or ``module:Class``.
        footprint: the robot's body, ``robot.footprint``.
        settings: an instance of the class's ``Config``; None = its defaults.
        seed: of what the policy draws.
        truth: the true scene, for a policy that needs it.
        goal: what the run is for: ``coverage``, ``reconstruction`` or ``both``.
    """
    told = default_settings(name) if settings is None else settings
    return registry.make_policy(name, PolicyContext(footprint, told, PlanningConfig(), seed, truth, goal))
