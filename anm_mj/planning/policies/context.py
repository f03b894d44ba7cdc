"""The one argument that every policy is made from, and a policy made from it by its name."""

from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from anm_mj.errors import PlanError
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.policies import registry
from anm_mj.planning.policies.registry import DEFAULT_GOAL, DEFAULT_POLICY, default_settings
from anm_mj.protocols import Policy
from anm_mj.types import Footprint
from anm_mj.utils.settings import Settings

SettingsT = TypeVar("SettingsT")


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


@dataclass(frozen=True)
class PolicyConfig(Settings, group="policy", error=PlanError):
    """Base of the policies' settings, which are the fields of each subclass; it has none itself."""


@dataclass(frozen=True)
class PolicyContext(Generic[SettingsT]):
    """What a policy knows before its first observation."""

    footprint: Footprint
    """The robot's body."""
    settings: SettingsT
    """The policy's own settings: an instance of the class's ``Config``."""
    planning: PlanningConfig = PlanningConfig()  # noqa: RUF009
    """Settings of the shared planning stages."""
    seed: int = 0
    """Seed of whatever the policy draws."""
    truth: object = None
    """The scene as it is, an :class:`anm_mj.evaluation.scene_truth.SceneTruth`; None for policies whose registry entry
    does not ask for it."""
    goal: str = DEFAULT_GOAL
    """What the run is for: one of ``GOALS``. A policy that can only look for new surface ignores it."""
