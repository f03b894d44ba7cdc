"""The surface that a scene's episodes are rewarded for: the samples that the evaluation counts."""

from __future__ import annotations

import math

from anm_mj.environments.reward import SampleGrid
from anm_mj.evaluation.ground_truth_cache import cached_ground_truth
from anm_mj.evaluation.pixel_rays import CameraExtrinsics
from anm_mj.scene.folder import Scene
from anm_mj.types import Footprint, Intrinsics, Observation, Pose2

_RUN_PX = 256
"""Width and height of the pictures of a run: what can be seen is asked for these, whatever the size of an episode's,
so that both count the same."""


def observable_surface(scene: Scene, footprint: Footprint, view: Observation, start: Pose2) -> SampleGrid:
    """The samples that can be seen at all from where the robot can go, or all where that cannot be computed.

    It takes seconds once per scene and robot, and is kept in the user's cache folder.

    Args:
        scene: the world.
        footprint: of the robot.
        view: any view with true poses, which says where the robot carries its camera.
        start: a place from which the robot gets to all others.

    Raises:
        SceneError: the scene has no surface, or next to no floor.
    """
    fov_y_rad = 2.0 * math.atan(view.intrinsics.height / 2.0 / view.intrinsics.fy)
    camera = CameraExtrinsics.of_view(Intrinsics.from_fov(_RUN_PX, _RUN_PX, fov_y_rad), view.T_world_camera, view.pose)
    truth = cached_ground_truth(scene, footprint, camera, start)
    return SampleGrid(truth.samples if truth.observable is None else truth.samples[truth.observable])
