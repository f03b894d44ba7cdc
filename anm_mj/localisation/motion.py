"""Where a frame was probably taken, before it is looked at: the prior of its registration."""

import math
import statistics

import numpy as np
from jaxtyping import Float, Float64

from anm_mj.localisation.localisation_config import MotionConfig
from anm_mj.localisation.registration import Prior
from anm_mj.localisation.se3 import camera_motion, rotation_vector, skew

_PRIOR_FRAMES = 4
"""What is expected of motions counts as much as so many frames."""
_POSE_SHARE = 0.25
"""Squared errors of single registrations are about this share of their stated variance."""


def moved_by_odometry(
    T_world_camera: Float[np.ndarray, "4 4"],
    covariance: Float64[np.ndarray, "k k"],
    basis: Float64[np.ndarray, "6 k"],
    T_odometry_before: Float[np.ndarray, "4 4"],
    T_odometry_now: Float[np.ndarray, "4 4"],
    config: MotionConfig,
    scale: float = 1.0,
) -> Prior:
    """The prior by a motion that odometry measured.

    Args:
        T_world_camera: The camera's estimated pose at the last frame.
        covariance: Of it, by the directions of ``basis``.
        basis: As of :class:`~.registration.Prior`.
        T_odometry_before: The camera's pose at the last frame as odometry has it, in a frame of its own.
        T_odometry_now: Likewise now.
        config: How far odometry is believed.
        scale: Of the standard deviation of its motions.
    """
    T = T_world_camera @ np.linalg.inv(T_odometry_before) @ T_odometry_now
    motion = T_world_camera[:3, :3].T @ (T[:3, 3] - T_world_camera[:3, 3])
    distance = math.sqrt(float(motion @ motion))
    turned = rotation_vector(T_odometry_now[:3, :3] @ T_odometry_before[:3, :3].T)
    angle = math.sqrt(float(turned @ turned))
    a1, a2, a3, a4 = config.odometry_alpha
    floor_m, floor_rad = config.odometry_floor
    translation = a3 * distance**2 + a4 * angle**2 + floor_m**2
    rotation = a1 * angle**2 + a2 * distance**2 + floor_rad**2
    return _moved(covariance, basis, T_world_camera, T, scale**2 * translation, scale**2 * rotation)


def moved_at_constant_velocity(
    T_world_camera: Float[np.ndarray, "4 4"],
    covariance: Float64[np.ndarray, "k k"],
    basis: Float64[np.ndarray, "6 k"],
    T_last_now: Float[np.ndarray, "4 4"],
    config: MotionConfig,
    scale: float = 1.0,
) -> Prior:
    """The prior by the motion before the last frame, going on.

    Args:
        T_world_camera: The camera's estimated pose at the last frame.
        covariance: Of it, by the directions of ``basis``.
        basis: As of :class:`~.registration.Prior`.
        T_last_now: The motion from the frame before the last one to that, in the camera's axes.
        config: How far the motion is believed to go on.
        scale: Of the standard deviation of motions.
    """
    T = T_world_camera @ T_last_now
    distance = float(np.linalg.norm(T_last_now[:3, 3]))
    angle = float(np.linalg.norm(rotation_vector(T_last_now[:3, :3])))
    translation = config.free_translation_m**2 + (config.free_share * distance) ** 2
    rotation = config.free_rotation_rad**2 + (config.free_share * angle) ** 2
    return _moved(covariance, basis, T_world_camera, T, scale**2 * translation, scale**2 * rotation)


class MotionModel:
    """Expects where the next frame was taken: by odometry, or as if the motion before went on."""

    def __init__(self, config: MotionConfig, basis: Float64[np.ndarray, "6 k"], *, has_odometry: bool) -> None:
        """Before any frame; ``basis`` as of :class:`~.registration.Prior`."""
        self._config, self._basis, self._has_odometry = config, basis, has_odometry
        self._noise = MotionNoise(config)
        self._scale = self._noise.scale
        """As of the last prior."""
        self._T_odometry: Float[np.ndarray, "4 4"] | None = None
        """The camera's pose at the last frame as odometry has it."""
        self._T_last_now = np.eye(4)

    def prior(
        self,
        T_world_camera: Float[np.ndarray, "4 4"],
        covariance: Float64[np.ndarray, "k k"],
        T_odometry: Float[np.ndarray, "4 4"],
    ) -> Prior:
        """Of the next frame.

        Args:
            T_world_camera: The camera's pose at the last frame.
            covariance: Of it.
            T_odometry: The camera's pose now as odometry has it, in a frame of its own.
        """
        self._scale = self._noise.scale
        before = T_world_camera, covariance, self._basis
        if self._has_odometry and self._T_odometry is not None:
            return moved_by_odometry(*before, self._T_odometry, T_odometry, self._config, self._scale)
        return moved_at_constant_velocity(*before, self._T_last_now, self._config, self._scale)

    def learn(self, prior: Prior, T_world_camera: Float[np.ndarray, "4 4"]) -> None:
        """Take in what a frame's pose says of its prior, which tells how noisy motions are."""
        self._noise.add(prior, T_world_camera, self._scale)

    def move(self, T_last_now: Float[np.ndarray, "4 4"], T_odometry: Float[np.ndarray, "4 4"]) -> None:
        """Take in how the camera moved since the frame before, and where odometry has it."""
        self._T_last_now, self._T_odometry = T_last_now, T_odometry


class MotionNoise:
    """How much larger the errors of motions are than expected, by what registration corrects."""

    def __init__(self, config: MotionConfig) -> None:
        self._config = config
        self._squares: list[float] = []
        """Squared corrections of the last frames, in the median expected."""

    @property
    def scale(self) -> float:
        """Factor of the standard deviation; at least 1."""
        if not self._squares:
            return 1.0
        share = len(self._squares) / (len(self._squares) + _PRIOR_FRAMES)
        learnt = math.sqrt(statistics.median(self._squares))
        return max(1.0, share * learnt + 1.0 - share)

    def add(self, prior: Prior, T_world_camera: Float[np.ndarray, "4 4"], scale: float) -> None:
        """Take in what a frame's pose says of its prior, which was made with a scale."""
        assert prior.motion_covariance is not None
        offset = prior.basis.T @ camera_motion(prior.T_world_camera, T_world_camera)
        # Median of chi-square (Wilson and Hilferty, 1931).
        usual = len(offset) * (1.0 - 2.0 / (9.0 * len(offset))) ** 3
        # The pose before is known better than its covariance says, which would hide the noise of short motions.
        covariance = prior.motion_covariance + _POSE_SHARE * (prior.covariance - prior.motion_covariance)
        square = scale**2 * float(offset @ np.linalg.solve(covariance, offset)) / usual
        self._squares = [*self._squares, square][-self._config.learn_frames :]


def _moved(
    covariance: Float64[np.ndarray, "k k"],
    basis: Float64[np.ndarray, "6 k"],
    T_before: Float[np.ndarray, "4 4"],
    T_now: Float[np.ndarray, "4 4"],
    translation_m2: float,
    rotation_rad2: float,
) -> Prior:
    """Prior after a motion: an error of the heading turns the way that follows."""
    transition = np.eye(6)
    transition[:3, 3:] = -skew(T_now[:3, 3] - T_before[:3, 3])
    transition = basis.T @ transition @ basis
    motion = basis.T @ np.diag([translation_m2] * 3 + [rotation_rad2] * 3) @ basis
    return Prior(T_now, transition @ covariance @ transition.T + motion, basis, motion)
