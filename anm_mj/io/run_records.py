"""What a line of ``frames.jsonl`` says."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from anm_mj.types import Pose2


@dataclass(frozen=True)
class FrameRecord:
    """One observation of a run: poses of the robot and of its camera, as they were believed, and the true ones."""

    step: int
    time_s: float
    pose: Pose2
    T_world_camera: Float[np.ndarray, "4 4"]
    true_pose: Pose2
    T_true_camera: Float[np.ndarray, "4 4"]
    is_lost: bool = False
    """Whether localisation did not know the pose."""
    is_mapped: bool = True
    """Whether the pose was good enough for the map."""
    closes_loop: bool = False
    """Whether it moved earlier keyframes, because a place was seen again."""
    people: tuple[tuple[float, float, float, float, float], ...] = ()
    """Of each person in the scene: x [m], y [m], yaw [rad], phase of the gait [rad], swing of the limbs."""
    chair: tuple[float, float, float] | None = None
    """Where the chair that is pushed stood: x [m], y [m], yaw [rad]; None without."""
    vacuums: tuple[tuple[float, float, float], ...] = ()
    """Of each vacuum robot: x [m], y [m], yaw [rad]."""
    doors: tuple[tuple[float, float, float, float], ...] = ()
    """Of each leaf of a door: x and y of the hinge [m], yaw [rad], length [m]."""
    covariance_xy_m2: tuple[float, float, float] | None = None
    """Of the camera's place in the plane, by localisation: xx, xy, yy [m^2]; None without."""
    image_age_s: float = 0.0
    """How long before ``time_s`` the image was taken, by its stamp, as is the pose of the camera [s]."""

    @property
    def image_time_s(self) -> float:
        """The stamp of the image [s]."""
        return self.time_s - self.image_age_s
