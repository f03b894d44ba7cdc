"""Common part of the two drives: the simulated base, its kinematics, its odometer and the look-at controller."""

import math

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.control.action_motion import Trapezoid
from anm_mj.control.look_at import LookAt, PlanarLookAt
from anm_mj.control.speed_and_acceleration import MotionLimits
from anm_mj.errors import RobotError
from anm_mj.localisation.odometry import Odometer, odometer_of
from anm_mj.people.crowd import Crowd
from anm_mj.people.figures import Figures
from anm_mj.robot.base_joints import simulated_base
from anm_mj.robot.description import RobotDescription
from anm_mj.robot.kinematics import PlanarKinematics, kinematics_of
from anm_mj.sim.drives.trail import Trail
from anm_mj.types import Pose2, Twist, WheelSpeeds

STILL = WheelSpeeds(0.0, 0.0)


class WheelDrive:
    """A base in a simulation; the subclasses move it."""

    REBUILT = ("_data", "_base", "_kinematics", "_description", "_look_at", "_figures")

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        description: RobotDescription,
        limits: MotionLimits,
        odometer: Odometer | None,
        prefix: str,
        *,
        period_s: float,
    ):
        """Drive ``data`` from the present pose of its base; in a scene ``prefix`` stands before the robot's names.

        Without an odometer, wheels are read without noise; ``period_s`` is the time between two commands of the look-at
        controller [s]. Raises RobotError if the model lacks a joint of the robot.
        """
        self._data = data
        self._base = simulated_base(model, data, prefix, description)
        self._kinematics = kinematics_of(description)
        self._limits = limits
        self._odometer = odometer or odometer_of(self._kinematics)
        self._odometer.reset(self._base.pose, self._base.wheel_angles_rad)
        self._description = description
        self._period_s = period_s
        self._look_at: LookAt | None = None
        self._crowd: Crowd | None = None
        self._figures: Figures | None = None
        self._trail: Trail | None = None

    def move_among(self, crowd: Crowd, figures: Figures) -> None:
        """Let people move on as time passes from now on; they are obstacles."""
        self._crowd, self._figures = crowd, figures
        figures.write(crowd, self._data)

    def restart_people(self, robot: Pose2, seed: int | None) -> None:
        """Place those who move anew around a robot at a pose; ``seed`` as of :meth:`Crowd.restart`."""
        if self._crowd is not None and self._figures is not None:
            self._crowd.restart(robot.xy_m, seed)
            self._figures.write(self._crowd, self._data)

    def leave(self, trail: Trail) -> None:
        """Leave a trail from now on."""
        self._trail = trail

    @property
    def crowd(self) -> Crowd | None:
        """Those who move on with this drive; None for nobody."""
        return self._crowd

    @property
    def figures(self) -> Figures | None:
        """Their bodies in the simulation."""
        return self._figures

    @property
    def trail(self) -> Trail | None:
        """What this drive leaves; None for nothing."""
        return self._trail

    def reseed(self, seed: int) -> None:
        """Begin the noise of the encoders of a seed."""
        self._odometer.reseed(seed)

    @property
    def limits(self) -> MotionLimits:
        """Of its speed and acceleration."""
        return self._limits

    @property
    def pose(self) -> Pose2:
        """True pose of the base."""
        return self._base.pose

    @property
    def odometry(self) -> Pose2:
        """Pose of the base by wheel odometry; slip and encoder noise make it drift."""
        return self._odometer.pose

    def _pass_time(self) -> None:
        """Let people move on to the present time of the simulation."""
        if self._crowd is None or self._figures is None:
            return
        if self._crowd.next_s > self._data.time + 1e-9:
            return
        if self._trail is not None:
            self._trail.follow(self._crowd, self._figures, self._data, self._base.pose.xy_m)
        elif self._crowd.follow(self._data.time, self._base.pose.xy_m):
            self._figures.write(self._crowd, self._data)

    def _note(self, profile: Trapezoid | None = None) -> None:
        """Take the present state into the trail; ``profile`` as of :meth:`Trail.add`."""
        if self._trail is not None:
            self._trail.add(self._data, self.odometry, profile)

    def _look_at_controller(self) -> LookAt:
        """The look-at controller at rest; made at the first call."""
        if self._look_at is None:
            if isinstance(self._kinematics, PlanarKinematics):
                self._look_at = PlanarLookAt(self._kinematics, self._limits, period_s=self._period_s)
            else:
                self._look_at = LookAt(self._description, self._kinematics, self._limits, period_s=self._period_s)
        self._look_at.reset()
        return self._look_at

    def _turned_rad(self, start_angles_rad: Float[np.ndarray, " n"]) -> tuple[float, float]:
        """What the encoders of both sides measured since they read these angles [rad]; 0 without wheels."""
        if not self._description.wheel_joints:
            return 0.0, 0.0
        left, right = (self._base.wheel_angles_rad - start_angles_rad).tolist()
        return left, right

    def _mean_speeds(self, start_s: float, start_angles_rad: Float[np.ndarray, " n"]) -> WheelSpeeds:
        """Mean wheel speeds since a time and its wheel angles; 0 without wheels."""
        duration_s = max(self._data.time - start_s, self._period_s)
        left_rad, right_rad = self._turned_rad(start_angles_rad)
        return WheelSpeeds(left_rad / duration_s, right_rad / duration_s)


def require_motion(twist: Twist, duration_s: float) -> None:
    """Raises RobotError unless the velocity is finite and the duration finite and positive."""
    if not (math.isfinite(twist.forward_mps) and math.isfinite(twist.turn_radps)):
        raise RobotError(
            f"A velocity of {twist.forward_mps} m/s and {twist.turn_radps} rad/s cannot be driven; both must be finite."
        )
    if not (math.isfinite(duration_s) and duration_s > 0.0):
        raise RobotError(f"A motion of {duration_s} s cannot be made; its duration must be positive, as 0.1.")
