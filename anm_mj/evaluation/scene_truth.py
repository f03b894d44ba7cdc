"""The true scene, for policies that need the truth; no other policy gets it."""

from __future__ import annotations

from dataclasses import dataclass

from anm_mj.ground_truth.ground_truth import GroundTruth
from anm_mj.ground_truth.observable import ReachableArea
from anm_mj.ground_truth.pixel_rays import CameraExtrinsics


@dataclass(frozen=True)
class SceneTruth:
    """The true scene, for policies whose registry entry says ``needs_truth``."""

    surface: GroundTruth
    """The true surface, with its observable part."""
    reachable: ReachableArea
    """Where the robot can get to."""
    camera: CameraExtrinsics
    """The camera on the robot."""
    budget_steps: int
    """Steps of the run."""
