"""The one argument that every policy is made from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

from anm_mj.planning.config import PlanningConfig
from anm_mj.types import Footprint

SettingsT = TypeVar("SettingsT")


@dataclass(frozen=True)
class NoSettings:
    """The configuration of a policy that has nothing to set."""


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
