"""Where the wheels' encoders say that the robot is: what a real robot would know without a map."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from anm_mj.robot.kinematics import RobotKinematics
from anm_mj.types import Pose2


class Odometer:
    """Adds up what the wheels have rolled, as SE(2) exponentials of :meth:`RobotKinematics.odometry`.

    Its error grows without bound: by slip where physics lets the wheels slip, and by the encoders' noise, if any. The
    noise of one wheel's rotation has a variance in proportion to the rotation, so that it does not matter how often the
    encoders are read.

    Source: Siegwart, Nourbakhsh and Scaramuzza, Introduction to Autonomous Mobile Robots, 2011, section 5.2.4.
    """

    def __init__(self, robot: RobotKinematics, *, noise: float = 0.0, seed: int = 0):
        """Start at the origin.

        Args:
            robot: its kinematics.
            noise: standard deviation of a wheel's measured rotation after one radian of it [rad].
            seed: of the noise.
        """
        self._robot = robot
        self._noise = noise
        self._generator = np.random.default_rng(seed)
        self._angles_rad = np.zeros(2)
        self._pose = Pose2(0.0, 0.0, 0.0)

    @property
    def pose(self) -> Pose2:
        """The estimate."""
        return self._pose

    def restart(self, pose: Pose2, angles_rad: Float[np.ndarray, "2"]) -> None:
        """Forget the past: the robot is known to stand at a pose, its wheels at these angles."""
        self._pose = pose
        self._angles_rad = angles_rad.copy()

    def read(self, angles_rad: Float[np.ndarray, "2"]) -> None:
        """Take the encoders' new angles in; between two readings the wheels turn at a constant ratio."""
        left, right = (angles_rad - self._angles_rad).tolist()
        self._angles_rad = angles_rad.copy()
        if self._noise:
            spread = self._noise * self._generator.standard_normal(2)
            left += spread[0] * math.sqrt(abs(left))
            right += spread[1] * math.sqrt(abs(right))
        self._pose = self._robot.odometry(self._pose, left, right)
