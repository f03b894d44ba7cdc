"""The stage's border: observation and prior go in; estimated pose, covariance and quality come out. And what a robot
does whose pose is not known.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from anm_mj.frames import pose_matrix, pose_of_matrix
from anm_mj.geometry.polyline import NUM_HEADINGS
from anm_mj.sensing.pose_check import is_stand_in
from anm_mj.types import Action, MapUpdate, Observation, Plan, Pose2, StopReason

MOST_LOST_STEPS = 3 * NUM_HEADINGS
"""A robot that is lost for longer, three whole rotations, gives up."""


class TrackingState(StrEnum):
    """Whether the pose is known."""

    TRACKING = "TRACKING"
    """The pose is known, or predicted over a few frames that could not be registered."""
    LOST = "LOST"
    """The pose is not known; nothing is mapped before the camera is found again."""


@dataclass(frozen=True)
class RegistrationQuality:
    """How well a frame fits the map at its estimated pose."""

    known: float
    """Share of the frame's points that show surface which the map knows, in [0, 1]."""
    inliers: float
    """Share of the known points that fit, in [0, 1]; points off by two standard deviations count a quarter."""
    bound: int
    """Directions of motion along which the frame tells more than the prior."""


def largest_deviations(covariance: Float[np.ndarray, "6 6"]) -> tuple[float, float]:
    """Largest standard deviations along any direction of a displacement [m] and about any axis of a rotation [rad]."""
    position, rotation = (np.linalg.eigvalsh(covariance[part, part])[-1] for part in (slice(3), slice(3, 6)))
    return float(np.sqrt(position)), float(np.sqrt(rotation))


@dataclass(frozen=True)
class PoseEstimate:
    """What localisation says of one frame."""

    observation: Observation
    """The frame with the estimated pose (``T_world_camera`` and ``pose``)."""
    covariance: Float[np.ndarray, "6 6"]
    """Of the camera's displacement in the world [m], then of its rotation vector about world axes [rad]; with that of
    the map, which the deviations of ``observation`` leave out."""
    quality: RegistrationQuality
    state: TrackingState
    usable: bool
    """Whether the pose is good enough for the frame's pixels to enter the map."""
    relocalised: bool = False
    """Whether the pose was found from scratch, after the camera was lost."""
    guessed: bool = False
    """Whether nothing tells the pose, no odometry, map or image: the camera is held where it was."""

    @property
    def position_deviation_m(self) -> float:
        """Largest standard deviation of the position along any direction [m]."""
        return largest_deviations(self.covariance)[0]

    @property
    def rotation_deviation_rad(self) -> float:
        """Largest standard deviation of the rotation about any axis [rad]."""
        return largest_deviations(self.covariance)[1]


@runtime_checkable
class Localiser(Protocol):
    """Estimates the pose of every frame of a stream, in order."""

    def localise(self, observation: Observation) -> PoseEstimate:
        """Estimate the pose of the next frame.

        Args:
            observation: The frame; its pose is the prior's (by odometry), in a frame that may drift against the world.

        Returns:
            The estimate. A frame that is not ``usable`` must not enter the map.
        """
        ...

    def integrate(self, estimate: PoseEstimate) -> MapUpdate:
        """Take a usable frame into the map, with as much training as localisation needs.

        Raises:
            MapError: The map cannot be trained any further.
        """
        ...


class BaseOfCamera:
    """Tells the base's pose by that of the camera."""

    REBUILT = ("_base_pose",)

    def __init__(self, base_pose: Callable[[Float[np.ndarray, "4 4"]], Pose2] | None) -> None:
        """Of a camera whose base ``base_pose`` gives; None = it is mounted as at the first frame with a pose."""
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
        if self._T_camera_base is None and not is_stand_in(observation):
            self._T_camera_base = T_camera_base
        return pose_of_matrix(T_world_camera @ T_camera_base)


def look_around(lost_steps: int) -> Plan | None:
    """The next plan of a robot whose pose was known ``lost_steps`` ago the last time; None where it is known.

    It turns on the spot until it is found, or gives up.
    """
    if not lost_steps:
        return None
    if lost_steps > MOST_LOST_STEPS:
        return Plan(f"lost for {lost_steps} steps: no place in the map fits what the camera sees", stop=StopReason.LOST)
    return Plan("lost: looks around until a place in the map fits", actions=(Action.TURN_LEFT,) * 6)
