"""The one argument that every policy is made from."""

from dataclasses import dataclass
from typing import Generic, TypeVar

from anm_mj.errors import PlanError
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.policies.registry import DEFAULT_GOAL
from anm_mj.types import Footprint
from anm_mj.utils.settings import Settings

SettingsT = TypeVar("SettingsT")


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
