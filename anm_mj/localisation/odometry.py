"""Wheel odometry: the pose that a robot infers from its wheel encoders, without a map."""

from __future__ import annotations

import copy
import math

import numpy as np
from jaxtyping import Float

from anm_mj.frames import move_pose
from anm_mj.robot.kinematics import Kinematics, RobotKinematics
from anm_mj.types import Pose2


class Odometer:
    """Integrates wheel rotations by the SE(2) exponentials of :meth:`RobotKinematics.odometry`.

    The error grows without bound: by slip, which only physics simulates, and by encoder noise. The variance of the
    noise is proportional to the rotation of the wheel, so its effect does not depend on the reading rate.

    Source: Siegwart, Nourbakhsh and Scaramuzza, Introduction to Autonomous Mobile Robots, 2011, section 5.2.4.
    """

    REBUILT = ("_kinematics",)

    def __init__(self, kinematics: RobotKinematics, *, noise: float = 0.0, seed: int = 0):
        """Start at the origin. ``noise`` is the standard deviation of a wheel's measured rotation after one radian
        [rad], ``seed`` is of it.
        """
        self._kinematics = kinematics
        self._begin(2, noise, seed)

    def _begin(self, num_angles: int, noise: float, seed: int) -> None:
        self._noise = noise
        self.reseed(seed)
        self.reset(Pose2(0.0, 0.0, 0.0), np.zeros(num_angles))

    @property
    def pose(self) -> Pose2:
        """The estimated pose."""
        return self._pose

    def copied(self) -> Odometer:
        """The same readings and the same noise to come, to go on by itself."""
        other = copy.copy(self)
        other._generator = copy.deepcopy(self._generator)
        return other

    def reseed(self, seed: int) -> None:
        """Begin the noise of a seed."""
        self._generator = np.random.default_rng(seed)

    def reset(self, pose: Pose2, angles_rad: Float[np.ndarray, " n"]) -> None:
        """Restart at a known pose with these wheel angles."""
        self._pose = pose
        self._angles_rad = angles_rad.copy()

    def update(self, angles_rad: Float[np.ndarray, "2"]) -> None:
        """Integrate new wheel angles; between two readings the wheel speeds keep their ratio."""
        left, right = (angles_rad - self._angles_rad).tolist()
        self._angles_rad = angles_rad.copy()
        if self._noise:
            spread = self._noise * self._generator.standard_normal(2)
            left += spread[0] * math.sqrt(abs(left))
            right += spread[1] * math.sqrt(abs(right))
        self._pose = self._kinematics.odometry(self._pose, left, right)


class PlanarOdometer(Odometer):
    """Integrates what the joints of a holonomic base read; it never slips.

    The noise is the standard deviation of a reading after one metre [m], and after one radian [rad].
    """

    def __init__(self, *, noise: float = 0.0, seed: int = 0):
        """Start at the origin; see :class:`Odometer`."""
        self._begin(3, noise, seed)

    def update(self, angles_rad: Float[np.ndarray, "3"]) -> None:
        """Integrate new positions of the joints: x [m], y [m], yaw [rad]."""
        dx, dy, turn = (angles_rad - self._angles_rad).tolist()
        half_way = self._angles_rad[2] + turn / 2.0
        self._angles_rad = angles_rad.copy()
        c, s = math.cos(half_way), math.sin(half_way)
        forward, left = dx * c + dy * s, dy * c - dx * s
        if self._noise:
            spread = self._noise * self._generator.standard_normal(3)
            forward += spread[0] * math.sqrt(abs(forward))
            left += spread[1] * math.sqrt(abs(left))
            turn += spread[2] * math.sqrt(abs(turn))
        c, s = math.cos(self._pose.yaw_rad + turn / 2.0), math.sin(self._pose.yaw_rad + turn / 2.0)
        x, y = self._pose.x_m + c * forward - s * left, self._pose.y_m + s * forward + c * left
        self._pose = move_pose(Pose2(x, y, self._pose.yaw_rad), 0.0, turn)


def odometer_of(kinematics: Kinematics, *, noise: float = 0.0, seed: int = 0) -> Odometer:
    """The odometer that goes with a base; arguments as for :class:`Odometer`."""
    if isinstance(kinematics, RobotKinematics):
        return Odometer(kinematics, noise=noise, seed=seed)
    return PlanarOdometer(noise=noise, seed=seed)
