"""Where a robot's base is whose camera was localised."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from anm_mj.frames import pose_matrix, pose_of_matrix
from anm_mj.types import Observation, Pose2


class BaseOfCamera:
    """Tells the base's pose by that of the camera."""

    REBUILT = ("_base_pose",)

    def __init__(self, base_pose: Callable[[Float[np.ndarray, "4 4"]], Pose2] | None) -> None:
        """Of a camera whose base ``base_pose`` gives; None = it is mounted as at the first frame."""
        self._base_pose = base_pose
        self._T_camera_base: Float[np.ndarray, "4 4"] | None = None

    def pose(self, observation: Observation, T_world_camera: Float[np.ndarray, "4 4"]) -> Pose2:
        """The base's pose, for a frame whose camera was found at ``T_world_camera``."""
        if self._base_pose is not None:
            return self._base_pose(T_world_camera)
        T_camera_base = self._T_camera_base
        if T_camera_base is None or observation.image_age_s:
            # With a late image the base has moved since, by what odometry says.
            T_camera_base = np.linalg.inv(observation.T_world_camera) @ pose_matrix(observation.pose)
        if self._T_camera_base is None:
            self._T_camera_base = T_camera_base
        return pose_of_matrix(T_world_camera @ T_camera_base)
