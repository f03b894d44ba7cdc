"""The stage's border: observation and prior go in; estimated pose, covariance and quality come out."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from anm_mj.types import MapUpdate, Observation


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
    rmse_m: float
    """Root of the mean squared distance of those points to the surface, weighted as they fit [m]; NaN without any."""
    bound: int
    """Directions of motion, of ``dof``, along which the frame tells more than the prior."""
    dof: int
    """Degrees of freedom: 3 for a base on the floor, 6 for a free camera."""


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
