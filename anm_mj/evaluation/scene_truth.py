"""What a simulated scene tells a policy that may know it, and tells no other."""

from __future__ import annotations

from dataclasses import dataclass

from anm_mj.evaluation.ground_truth import GroundTruth
from anm_mj.evaluation.observable import ReachableArea
from anm_mj.evaluation.pixel_rays import CameraExtrinsics


@dataclass(frozen=True)
class SceneTruth:
    """The true scene, for policies whose registry entry says ``needs_truth``."""

    surface: GroundTruth
    """The true surface, with its observable part."""
    reachable: ReachableArea
    """Where the robot can get to."""
    camera: CameraExtrinsics
    """How the robot carries its camera."""
