"""A drive without physics: every motion is executed exactly, or not at all."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.control.look_at import LookAt
from anm_mj.control.motion import MotionLimits, action_motion, action_profile
from anm_mj.control.odometry import Odometer
from anm_mj.control.simulated_base import SimulatedBase
from anm_mj.errors import RobotError
from anm_mj.geometry.clearance import Clearance
from anm_mj.robot.description import RobotDescription
from anm_mj.robot.kinematics import RobotKinematics
from anm_mj.types import Action, ActionResult, MotionResult, Pose2, Twist, WheelSpeeds

_LOOK_PERIOD_S = 0.02
_STILL = WheelSpeeds(0.0, 0.0)


class KinematicDrive:
    """Moves the simulated base through wheel angles and forward kinematics, rolling without slip.

    A move that would touch something is refused as a whole: the robot stays where it is and does not slide along. The
    footprint is round about the point that the robot turns on, so a turn on the spot is never refused.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        description: RobotDescription,
        clearance: Clearance,
        limits: MotionLimits | None = None,
        odometer: Odometer | None = None,
        prefix: str = "",
    ):
        """Drive ``data`` from where its base stands.

        Args:
            model: the robot, alone or in a scene.
            data: of that model.
            description: the robot.
            clearance: of its footprint in the scene.
            limits: how fast the base would move; they decide about the simulated time alone.
            odometer: reads the wheels; None = one without noise.
            prefix: what the robot's names got before them when it was attached to the scene.

        Raises:
            RobotError: if the model lacks a joint of the robot.
        """
        self._data = data
        self._base = SimulatedBase(model, data, prefix, description)
        self._description = description
        self._robot = RobotKinematics.of(description)
        self._clearance = clearance
        self._limits = limits or MotionLimits()
        self._odometer = odometer or Odometer(self._robot)
        self._odometer.restart(self._base.pose, self._base.wheel_angles_rad)
        self._look: LookAt | None = None

    @property
    def pose(self) -> Pose2:
        """Where the base stands now."""
        return self._base.pose

    @property
    def odometry(self) -> Pose2:
        """Where the base stands as far as the wheels tell."""
        return self._odometer.pose

    def place(self, pose: Pose2) -> None:
        """Put the robot somewhere."""
        self._base.place(pose)
        self._odometer.restart(pose, self._base.wheel_angles_rad)

    def act(self, action: Action) -> ActionResult:
        """Execute an action at once; the simulated time moves on by what a real robot would take."""
        if action == Action.STOP:
            return ActionResult(action, collided=False, wheel_speeds=_STILL, moved_m=0.0)
        # The profile scales the twist in time and never changes its direction, so the wheels turn at a constant ratio
        # and one exponential of the whole motion is exact.
        forward_m, turn_rad = action_motion(action)
        duration_s = action_profile(action, self._limits).duration_s
        if not self._roll(forward_m, turn_rad, duration_s):
            return ActionResult(action, collided=True, wheel_speeds=_STILL, moved_m=0.0)
        speeds = self._robot.wheel_speeds(forward_m / duration_s, turn_rad / duration_s)
        return ActionResult(action, collided=False, wheel_speeds=speeds, moved_m=forward_m)

    def drive(self, twist: Twist, duration_s: float) -> MotionResult:
        """Roll at a velocity for a time [s], at once and as a whole.

        Raises:
            RobotError: if the duration is not positive, or the velocity not finite.
        """
        require_motion(twist, duration_s)
        forward_m, turn_rad = twist.forward_mps * duration_s, twist.turn_radps * duration_s
        if not self._roll(forward_m, turn_rad, duration_s):
            return MotionResult(True, _STILL, 0.0, 0.0, duration_s)
        speeds = self._robot.wheel_speeds(twist.forward_mps, twist.turn_radps)
        return MotionResult(False, speeds, abs(forward_m), abs(turn_rad), duration_s)

    def look_at(self, point_m: Float[np.ndarray, "3"]) -> MotionResult:
        """Turn on the spot until the camera's axis lies in one vertical plane with a point of the world."""
        if self._look is None:
            self._look = LookAt(self._description, self._robot, self._limits, period_s=_LOOK_PERIOD_S)
        look, start_s, start_angles, turned_rad = self._look, self._data.time, self._base.wheel_angles_rad, 0.0
        look.begin()
        while (following := look.next_pose(pose := self._base.pose, point_m)) is not None:
            turn_rad = math.remainder(following.yaw_rad - pose.yaw_rad, math.tau)
            self._roll(0.0, turn_rad, _LOOK_PERIOD_S)
            turned_rad += abs(turn_rad)
        took_s = self._data.time - start_s
        speeds = (self._base.wheel_angles_rad - start_angles) / max(took_s, _LOOK_PERIOD_S)
        return MotionResult(False, WheelSpeeds(float(speeds[0]), float(speeds[1])), 0.0, turned_rad, took_s)

    def _roll(self, forward_m: float, turn_rad: float, duration_s: float) -> bool:
        """Roll at a constant ratio of the wheels; False, the robot unmoved, when something is in the way."""
        self._data.time += duration_s
        pose = self._base.pose
        if forward_m and self._clearance.sweep_collides(pose, forward_m, turn_rad):
            return False
        left_rad, right_rad = self._robot.wheel_motion(forward_m, turn_rad)
        self._base.turn_wheels(left_rad, right_rad)
        self._base.place(self._robot.odometry(pose, left_rad, right_rad))
        self._odometer.read(self._base.wheel_angles_rad)
        return True


def require_motion(twist: Twist, duration_s: float) -> None:
    """Raises RobotError unless a velocity is finite, and its duration finite and positive."""
    if not (math.isfinite(twist.forward_mps) and math.isfinite(twist.turn_radps)):
        raise RobotError(
            f"A velocity of {twist.forward_mps} m/s and {twist.turn_radps} rad/s cannot be driven; both must be finite."
        )
    if not (math.isfinite(duration_s) and duration_s > 0.0):
        raise RobotError(f"A motion of {duration_s} s cannot be made; its duration must be positive, as 0.1.")
