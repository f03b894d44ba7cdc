"""A drive by wheel torque and contact: the base goes where the wheels take it, and obstacles stop it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from anm_mj.control.motion import MotionLimits, action_motion, action_profile
from anm_mj.control.robot_model import WHEEL_JOINTS, RobotModel
from anm_mj.control.simulated_base import SimulatedBase
from anm_mj.control.wheel_servo import WheelServo
from anm_mj.errors import RobotError
from anm_mj.frames import move_pose, wrap_angle
from anm_mj.types import Action, ActionResult, Pose2, WheelSpeeds

_SHELL_GEOMS = ("chassis", "mast", "head")
"""Geoms that nothing should touch; wheels and casters touch the floor."""


@dataclass(frozen=True)
class PhysicsDriveConfig:
    """How the simulated motors are driven."""

    substep_s: float = 0.002
    """Physics step [s]. From 0.004 on the wheels' contact costs accuracy, at 0.010 they slip."""
    servo_period_s: float = 0.02
    """Time between two commands to the wheels [s]; a multiple of the substep."""
    max_wheel_radps: float = 12.0
    """Neither wheel is asked to turn faster [rad/s]."""
    settle_s: float = 0.3
    """Longest time after the planned end of an action to come to rest at the reference [s]."""
    settled_m: float = 0.0005
    """Distance to the reference, along the heading, at which an action is done [m]."""
    settled_rad: float = math.radians(0.02)
    """Angle to the reference at which an action is done [rad]."""
    rest_mps: float = 0.005
    """Speed below which the base counts as standing [m/s]."""
    rest_radps: float = 0.02
    """Turn rate below which the base counts as standing [rad/s]."""
    blocked_m: float = 0.005
    """Distance to the reference, along the heading, that means an obstacle when it is left after settling [m]."""
    blocked_rad: float = math.radians(0.5)
    """Angle to the reference that means an obstacle when it is left after settling [rad]."""
    pushed_m: float = 0.005
    """Sideways distance to the reference that means that something has pushed the robot aside [m]."""
    bump_cos: float = 0.25
    """Cosine between the heading and the direction to a touched obstacle above which the obstacle is in the way; what
    is touched with the robot's side is glided along."""

    def __post_init__(self):
        for name, value in vars(self).items():
            if not value > 0.0:
                raise RobotError(f"PhysicsDriveConfig.{name} is {value}; it must be positive.")
        ratio = self.servo_period_s / self.substep_s
        if abs(ratio - round(ratio)) > 1e-9:
            raise RobotError(
                f"PhysicsDriveConfig.servo_period_s is {self.servo_period_s}, which is not a multiple of substep_s, "
                f"{self.substep_s}; for example {round(ratio + 0.5) * self.substep_s:g} is."
            )


class PhysicsDrive:
    """Executes actions by a servo on the base's true pose.

    The servo follows the pose that has been commanded, which is carried over from action to action, so errors of single
    actions do not add up. After a collision, or a push from the side, the commanded pose is where the robot stands.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        mjcf_path: Path,
        robot: RobotModel,
        config: PhysicsDriveConfig | None = None,
        limits: MotionLimits | None = None,
        prefix: str = "",
    ):
        """Drive ``data`` from where its base stands.

        Args:
            model: the robot in a scene; its time step, integrator and friction cone are set to the ones driven with.
            data: of that model.
            mjcf_path: the robot alone, for mink.
            robot: its kinematics.
            config: how the motors are driven.
            limits: how fast the base moves.
            prefix: what the robot's names got before them when it was attached to the scene.

        Raises:
            RobotError: if the model lacks a joint, an actuator or a geom of the robot.
        """
        self._model, self._data = model, data
        self._config = config or PhysicsDriveConfig()
        self._limits = limits or MotionLimits()
        self._base = SimulatedBase(model, data, prefix)
        period_s, max_radps = self._config.servo_period_s, self._config.max_wheel_radps
        self._servo = WheelServo(mjcf_path, robot, period_s=period_s, max_wheel_radps=max_radps)
        self._motors = np.array([_id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, prefix + name) for name in WHEEL_JOINTS])
        self._is_shell = np.zeros(model.ngeom, dtype=bool)
        self._is_shell[[_id(model, mujoco.mjtObj.mjOBJ_GEOM, prefix + name) for name in _SHELL_GEOMS]] = True
        self._substeps = round(period_s / self._config.substep_s)
        self._reference = self._base.pose

        model.opt.timestep = self._config.substep_s
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC

    @property
    def pose(self) -> Pose2:
        """Where the base stands now."""
        return self._base.pose

    @property
    def reference(self) -> Pose2:
        """Where the base has been commanded to stand."""
        return self._reference

    def place(self, pose: Pose2) -> None:
        """Put the robot somewhere, at rest."""
        self._base.place(pose)
        self._data.qvel[:] = 0.0
        self._data.ctrl[self._motors] = 0.0
        self._reference = pose

    def act(self, action: Action) -> ActionResult:
        """Execute an action until the robot stands at the commanded pose, or an obstacle has stopped it."""
        if action == Action.STOP:
            return ActionResult(action, collided=False, wheel_speeds=WheelSpeeds(0.0, 0.0), moved_m=0.0)
        start, start_s, start_angles = self._base.pose, self._data.time, self._base.wheel_angles_rad
        blocked = self._follow(action)
        if blocked:
            self._halt()
        # No wheel can undo a push from the side, and the next turn would take it for a distance to be driven.
        if blocked or abs(self._offset_m()[1]) > self._config.pushed_m:
            self._reference = self._base.pose
        speeds = (self._base.wheel_angles_rad - start_angles) / (self._data.time - start_s)
        end = self._base.pose
        return ActionResult(
            action,
            collided=blocked,
            wheel_speeds=WheelSpeeds(float(speeds[0]), float(speeds[1])),
            moved_m=math.hypot(end.x_m - start.x_m, end.y_m - start.y_m),
        )

    def _follow(self, action: Action) -> bool:
        """Move the reference through the action, and the base after it; True when something is in the way."""
        config = self._config
        forward_m, turn_rad = action_motion(action)
        profile = action_profile(action, self._limits)
        start, start_s = self._reference, self._data.time
        self._reference = move_pose(start, forward_m, turn_rad)
        last_s = start_s + profile.duration_s + config.settle_s
        while self._data.time < last_s:
            fraction = profile.fraction(self._data.time + config.servo_period_s - start_s)
            if self._servo_period(move_pose(start, forward_m * fraction, turn_rad * fraction), bool(forward_m)):
                return True
            at_rest = self._base.speed_mps < config.rest_mps and abs(self._base.turn_rate_radps) < config.rest_radps
            if fraction == 1.0 and at_rest and self._is_at_reference(config.settled_m, config.settled_rad):
                return False
        return not self._is_at_reference(config.blocked_m, config.blocked_rad)

    def _servo_period(self, reference: Pose2, forward: bool) -> bool:
        """One command to the wheels and the substeps it holds for; True as soon as a forward move is in the way."""
        speeds = self._servo.wheel_speeds(self._base.pose, reference)
        self._data.ctrl[self._motors] = (speeds.left_radps, speeds.right_radps)
        for _ in range(self._substeps):
            mujoco.mj_step(self._model, self._data)
            if forward and self._bumps():
                return True
        return False

    def _halt(self) -> None:
        """Brake until the base stands."""
        self._data.ctrl[self._motors] = 0.0
        mujoco.mj_step(self._model, self._data, nstep=round(self._config.settle_s / self._config.substep_s))

    def _is_at_reference(self, along_m: float, angle_rad: float) -> bool:
        """Whether the base is as near to the reference as it can drive: sideways it cannot."""
        angle_off_rad = wrap_angle(self._reference.yaw_rad - self._base.pose.yaw_rad)
        return abs(self._offset_m()[0]) < along_m and abs(angle_off_rad) < angle_rad

    def _offset_m(self) -> tuple[float, float]:
        """How far the reference lies ahead of the base, and how far to its left."""
        pose, reference = self._base.pose, self._reference
        dx, dy = reference.x_m - pose.x_m, reference.y_m - pose.y_m
        c, s = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
        return dx * c + dy * s, dy * c - dx * s

    def _bumps(self) -> bool:
        """Whether the robot's shell touches something in the direction of its heading."""
        touching = self._is_shell[self._data.contact.geom]
        if not touching.any():
            return False
        yaw = self._base.pose.yaw_rad
        for contact, (first_is_robot, second_is_robot) in zip(self._data.contact, touching, strict=True):
            if first_is_robot == second_is_robot or contact.dist > 0.0:
                continue
            # The contact's normal points from its first geom to its second.
            outwards = contact.frame[:2] if first_is_robot else -contact.frame[:2]
            if outwards[0] * math.cos(yaw) + outwards[1] * math.sin(yaw) > self._config.bump_cos:
                return True
        return False


def _id(model: mujoco.MjModel, kind: mujoco.mjtObj, name: str) -> int:
    """Raises RobotError if the simulated robot lacks a part."""
    found = mujoco.mj_name2id(model, kind, name)
    if found < 0:
        what = kind.name.removeprefix("mjOBJ_").lower()
        raise RobotError(f'The simulated robot has no {what} "{name}"; see models/diff_drive/diff_drive.xml.')
    return found
