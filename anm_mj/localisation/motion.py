"""Where a frame was probably taken, before it is looked at: the prior of its registration."""

import math
import statistics

import numpy as np
from jaxtyping import Float, Float64

from anm_mj.localisation.localisation_config import MotionConfig
from anm_mj.localisation.registration import Prior
from anm_mj.localisation.se3 import camera_motion, moved_camera, rotation_vector, transition

_PRIOR_FRAMES = 4
"""What is expected of motions counts as much as so many frames."""
_POSE_SHARE = 0.25
"""Squared errors of single registrations are about this share of their stated variance."""


class MotionModel:
    """Expects where the next frame was taken: by odometry, or as if the motion before went on. How much larger the
    errors of motions are than expected is learnt from what registration corrects.

    Without odometry a camera whose motion nothing shows is held where it was: the motion before would carry it away
    without end.
    """

    def __init__(self, config: MotionConfig, basis: Float64[np.ndarray, "6 k"], *, has_odometry: bool) -> None:
        """Before any frame; ``basis`` as of :class:`~.registration.Prior`."""
        self._config, self._basis, self._has_odometry = config, basis, has_odometry
        self._squares: list[float] = []
        """Squared corrections of the last frames, in the median expected."""
        self._scale = 1.0
        """Factor of the standard deviation of motions, as of the last prior."""
        self._T_odometry: Float[np.ndarray, "4 4"] | None = None
        """The camera's pose at the last frame as odometry has it."""
        self._T_last_now = np.eye(4)
        self._num_held = 0
        """Frames in a row whose motion nothing showed,"""
        self._num_blind = 0
        """and the last of these that have no image either."""

    def prior(
        self,
        T_world_camera: Float[np.ndarray, "4 4"],
        covariance: Float64[np.ndarray, "k k"],
        T_odometry: Float[np.ndarray, "4 4"],
        T_believed: Float[np.ndarray, "4 4"] | None = None,
    ) -> Prior:
        """Of the next frame, from the camera's pose at the last one, and its covariance. ``T_odometry`` is the camera's
        pose now as odometry has it, in a frame of its own; ``T_believed`` the pose that was believed at the last frame,
        None = the same.
        """
        config = self._config
        if self._has_odometry and self._T_odometry is not None:
            T = T_world_camera @ np.linalg.inv(self._T_odometry) @ T_odometry
            motion = T_world_camera[:3, :3].T @ (T[:3, 3] - T_world_camera[:3, 3])
            distance = math.sqrt(float(motion @ motion))
            turned = rotation_vector(T_odometry[:3, :3] @ self._T_odometry[:3, :3].T)
            angle = math.sqrt(float(turned @ turned))
            a1, a2, a3, a4 = config.odometry_alpha
            floor_m, floor_rad = config.odometry_floor
            translation = a3 * distance**2 + a4 * angle**2 + floor_m**2
            rotation = a1 * angle**2 + a2 * distance**2 + floor_rad**2
        elif self._num_held and T_believed is None:
            return self._held(T_world_camera, covariance, self._num_held + 1, self._num_blind + 1)
        else:
            T_last_now = self._T_last_now
            if T_believed is not None and self._num_held:
                T_last_now = _share(np.linalg.inv(T_believed) @ T_world_camera, self._num_held)
            elif T_believed is not None:
                T_last_now = T_last_now @ np.linalg.inv(T_believed) @ T_world_camera
            T = T_world_camera @ T_last_now
            distance = float(np.linalg.norm(T_last_now[:3, 3]))
            angle = float(np.linalg.norm(rotation_vector(T_last_now[:3, :3])))
            translation = config.free_translation_m**2 + (config.free_share * distance) ** 2
            rotation = config.free_rotation_rad**2 + (config.free_share * angle) ** 2
        self._scale = self._learnt_scale
        variances = [self._scale**2 * translation] * 3 + [self._scale**2 * rotation] * 3
        # An error of the heading turns the way that follows.
        onward = self._basis.T @ transition(T_world_camera, T) @ self._basis
        motion = self._basis.T @ np.diag(variances) @ self._basis
        return Prior(T, onward @ covariance @ onward.T + motion, self._basis, motion)

    def hold(
        self, T_world_camera: Float[np.ndarray, "4 4"], covariance: Float64[np.ndarray, "k k"], *, has_image: bool
    ) -> Prior:
        """What is known, without odometry, of a frame whose motion nothing shows: the camera is where it was at the
        last one, whose pose and covariance are given. ``has_image``: the next frame may follow this one.
        """
        self._num_held += 1
        self._num_blind = 0 if has_image else self._num_blind + 1
        return self._held(T_world_camera, covariance, self._num_held, self._num_blind)

    def gone_on(self, T_world_camera: Float[np.ndarray, "4 4"], covariance: Float64[np.ndarray, "k k"]) -> Prior | None:
        """Of the next frame, had the motion before gone on all the time that the camera was held at a pose, which has
        this covariance by now; None where it is not held.
        """
        if not self._num_held:
            return None
        count = self._num_held + 1
        T = T_world_camera @ np.linalg.matrix_power(self._T_last_now, count)
        before = covariance - self._num_held**2 * self._lasting_covariance(goes_on=False)
        onward = self._basis.T @ transition(T_world_camera, T) @ self._basis
        motion = count**2 * self._lasting_covariance(goes_on=True)
        return Prior(T, onward @ before @ onward.T + motion, self._basis, motion)

    def learn(self, prior: Prior, T_world_camera: Float[np.ndarray, "4 4"]) -> None:
        """Take in what a frame's pose says of its prior, which tells how noisy motions are."""
        assert prior.motion_covariance is not None
        offset = prior.basis.T @ camera_motion(prior.T_world_camera, T_world_camera)
        # Median of chi-square (Wilson and Hilferty, 1931).
        usual = len(offset) * (1.0 - 2.0 / (9.0 * len(offset))) ** 3
        # The pose before is known better than its covariance says, which would hide the noise of short motions.
        covariance = prior.motion_covariance + _POSE_SHARE * (prior.covariance - prior.motion_covariance)
        square = self._scale**2 * float(offset @ np.linalg.solve(covariance, offset)) / usual
        self._squares = [*self._squares, square][-self._config.learn_frames :]

    def move(self, T_last_now: Float[np.ndarray, "4 4"], T_odometry: Float[np.ndarray, "4 4"]) -> None:
        """Take in how the camera moved since the last frame that was not held, and where odometry has it."""
        if self._num_held:
            T_last_now = _share(T_last_now, self._num_held + 1)
        self._T_last_now, self._T_odometry = T_last_now, T_odometry
        self._num_held = self._num_blind = 0

    def _held(
        self,
        T_world_camera: Float[np.ndarray, "4 4"],
        covariance: Float64[np.ndarray, "k k"],
        num_held: int,
        num_blind: int,
    ) -> Prior:
        """Of the last of ``num_held`` frames, from pose and covariance of the one before it; ``num_blind`` frames
        before it the camera gave the last image.
        """
        motion = self._lasting_covariance(goes_on=False)
        grown = (num_held**2 - (num_held - 1) ** 2) * motion
        return Prior(T_world_camera, covariance + grown, self._basis, num_blind**2 * motion)

    def _lasting_covariance(self, *, goes_on: bool) -> Float64[np.ndarray, "k k"]:
        """Of a frame's part of one motion that lasts, whose deviation grows with the time and not with the root of it:
        about the motion before, which ``goes_on``, or about none, as it may go on or end.
        """
        config, T = self._config, self._T_last_now
        squares = float(np.sum(T[:3, 3] ** 2)), float(np.sum(rotation_vector(T[:3, :3]) ** 2))
        floors = config.free_translation_m**2, config.free_rotation_rad**2
        variances = [
            (0.0 if goes_on else square) + self._scale**2 * (floor + config.free_share**2 * square)
            for square, floor in zip(squares, floors, strict=True)
        ]
        return self._basis.T @ np.diag(np.repeat(variances, 3)) @ self._basis

    @property
    def _learnt_scale(self) -> float:
        """Factor of the standard deviation; at least 1."""
        if not self._squares:
            return 1.0
        share = len(self._squares) / (len(self._squares) + _PRIOR_FRAMES)
        learnt = math.sqrt(statistics.median(self._squares))
        return max(1.0, share * learnt + 1.0 - share)


def _share(T_motion: Float[np.ndarray, "4 4"], count: int) -> Float[np.ndarray, "4 4"]:
    """One of so many equal parts of a motion."""
    return moved_camera(np.eye(4), camera_motion(np.eye(4), T_motion) / count)
