"""The true scene, for policies that need the truth; no other policy gets it."""

from dataclasses import dataclass

from anm_mj.ground_truth.ground_truth import GroundTruth
from anm_mj.ground_truth.observable import ReachableArea
from anm_mj.ground_truth.pixel_rays import CameraExtrinsics


@dataclass(frozen=True)
class SceneTruth:
    """The true scene, for policies whose registry entry says ``needs_truth``: the surface with its observable part,
    where the robot can get to, the camera on it, and the steps of the run.
    """

    surface: GroundTruth
    reachable: ReachableArea
    camera: CameraExtrinsics
    budget_steps: int
