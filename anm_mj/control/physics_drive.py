"""A drive by wheel torque and contact: the base goes where the wheels take it, and obstacles stop it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.control.clearance_limit import static_obstacles
from anm_mj.control.kinematic_drive import require_motion
from anm_mj.control.look_at import LookAt
from anm_mj.control.motion import MotionLimits, action_motion, action_profile
from anm_mj.control.odometry import Odometer
from anm_mj.control.simulated_base import SimulatedBase
from anm_mj.control.wheel_servo import WheelServo
from anm_mj.errors import RobotError
from anm_mj.frames import move_pose, wrap_angle
from anm_mj.robot.description import RobotDescription
from anm_mj.robot.kinematics import RobotKinematics
from anm_mj.types import Action, ActionResult, MotionResult, Pose2, Twist, WheelSpeeds

_STANDING = Twist(0.0, 0.0)
_TURN_LAG_RAD = math.radians(5.0)
"""A robot that stays behind its turning reference by this is held fast."""


@dataclass(frozen=True)
class PhysicsDriveConfig:
    """How the simulated motors are driven."""

    substep_s: float = 0.002
    """Physics step [s]. From 0.004 on the wheels' contact costs accuracy, at 0.010 they slip."""
    servo_period_s: float = 0.02
    """Time between two commands to the wheels [s]; a multiple of the substep."""
    max_wheel_radps: float = 12.0
    """Neither wheel is asked to turn faster [rad/s]."""
    keep_clear_m: float = 0.005
    """Distance between the robot's body and the obstacle boxes at which the servo stops it [m]."""
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
    lag_m: float = 0.02
    """Distance to the reference that means an obstacle, or a push, while driving at a velocity [m]."""
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
    """Executes motions by a servo on the base's true pose.

    The servo follows the pose that has been commanded, which is carried over from motion to motion, so errors of single
    actions do not add up. After a collision, or a push from the side, the commanded pose is where the robot stands.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        description: RobotDescription,
        config: PhysicsDriveConfig | None = None,
        limits: MotionLimits | None = None,
        odometer: Odometer | None = None,
        prefix: str = "",
    ):
        """Drive ``data`` from where its base stands.

        Args:
            model: the robot in a scene; its time step, integrator and friction cone are set to the ones driven with.
                Its static geoms are the obstacles that the servo keeps clear of.
            data: of that model.
            description: the robot.
            config: how the motors are driven.
            limits: how fast the base moves.
            odometer: reads the wheels; None = one without noise.
            prefix: what the robot's names got before them when it was attached to the scene.

        Raises:
            RobotError: if the model lacks a joint, an actuator or a geom of the robot, or mink drops an obstacle.
        """
        self._model, self._data = model, data
        self._config = config or PhysicsDriveConfig()
        self._limits = limits or MotionLimits()
        self._description = description
        self._base = SimulatedBase(model, data, prefix, description)
        self._robot = RobotKinematics.of(description)
        self._odometer = odometer or Odometer(self._robot)
        self._servo = WheelServo(
            description,
            self._robot,
            period_s=self._config.servo_period_s,
            max_wheel_radps=self._config.max_wheel_radps,
            obstacles=static_obstacles(model),
            keep_m=self._config.keep_clear_m,
        )
        self._signs = np.array(description.wheel_signs)
        self._motors = np.array([_id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, prefix + n) for n in description.motors])
        self._is_shell = np.zeros(model.ngeom, dtype=bool)
        self._is_shell[[_id(model, mujoco.mjtObj.mjOBJ_GEOM, prefix + name) for name in description.shell]] = True
        self._substeps = round(self._config.servo_period_s / self._config.substep_s)
        self._reference = self._base.pose
        self._odometer.restart(self._base.pose, self._base.wheel_angles_rad)
        self._twist = _STANDING
        self._look: LookAt | None = None

        model.opt.timestep = self._config.substep_s
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC

    @property
    def pose(self) -> Pose2:
        """Where the base stands now."""
        return self._base.pose

    @property
    def odometry(self) -> Pose2:
        """Where the base stands as far as the wheels tell, slip included."""
        return self._odometer.pose

    @property
    def reference(self) -> Pose2:
        """Where the base has been commanded to stand."""
        return self._reference

    def place(self, pose: Pose2) -> None:
        """Put the robot somewhere, at rest."""
        self._base.place(pose)
        self._data.qvel[:] = 0.0
        self._data.ctrl[self._motors] = 0.0
        self._reference, self._twist = pose, _STANDING
        self._odometer.restart(pose, self._base.wheel_angles_rad)

    def act(self, action: Action) -> ActionResult:
        """Execute an action until the robot stands at the commanded pose, or an obstacle has stopped it."""
        if self._twist != _STANDING:
            self.drive(_STANDING, self._braking_s())
        if action == Action.STOP:
            return ActionResult(action, collided=False, wheel_speeds=WheelSpeeds(0.0, 0.0), moved_m=0.0)
        start, start_s, start_angles = self._base.pose, self._data.time, self._base.wheel_angles_rad
        blocked = self._follow(action)
        if blocked:
            self._halt()
        # No wheel can undo a push from the side, and the next turn would take it for a distance to be driven.
        elif abs(self._offset_m()[1]) > self._config.pushed_m:
            self._reference = self._base.pose
        end = self._base.pose
        return ActionResult(
            action,
            collided=blocked,
            wheel_speeds=self._mean_speeds(start_s, start_angles),
            moved_m=math.hypot(end.x_m - start.x_m, end.y_m - start.y_m),
        )

    def drive(self, twist: Twist, duration_s: float) -> MotionResult:
        """Move at a velocity for a time [s], rounded up to servo periods.

        The velocity is neared at the limits' accelerations, and what the wheels cannot do is scaled down on the same
        arc. Afterwards the robot may still be moving: the next call of ``drive`` goes on from there, and an action, or
        ``Twist(0, 0)`` for long enough, brings it to rest first.

        Raises:
            RobotError: if the duration is not positive, or the velocity not finite.
        """
        require_motion(twist, duration_s)
        period_s = self._config.servo_period_s
        wanted = self._possible(twist)
        start_s, start_angles, moved_m, turned_rad = self._data.time, self._base.wheel_angles_rad, 0.0, 0.0
        blocked = False
        for _ in range(math.ceil(duration_s / period_s - 1e-9)):
            before = self._base.pose
            self._twist = self._nearer(wanted)
            forward_m, turn_rad = self._twist.forward_mps * period_s, self._twist.turn_radps * period_s
            self._reference = move_pose(self._reference, forward_m, turn_rad)
            blocked = self._servo_period(self._reference, self._twist.forward_mps > 0.0)
            after = self._base.pose
            moved_m += math.hypot(after.x_m - before.x_m, after.y_m - before.y_m)
            turned_rad += abs(wrap_angle(after.yaw_rad - before.yaw_rad))
            if blocked or math.hypot(*self._offset_m()) > self._config.lag_m:
                blocked = True
                self._halt()
                break
        return MotionResult(
            blocked, self._mean_speeds(start_s, start_angles), moved_m, turned_rad, self._data.time - start_s
        )

    def look_at(self, point_m: Float[np.ndarray, "3"]) -> MotionResult:
        """Turn on the spot until the camera's axis lies in one vertical plane with a point of the world."""
        if self._twist != _STANDING:
            self.drive(_STANDING, self._braking_s())
        period_s = self._config.servo_period_s
        if self._look is None:
            self._look = LookAt(self._description, self._robot, self._limits, period_s=period_s)
        start, start_s, start_angles, turned_rad = self._base.pose, self._data.time, self._base.wheel_angles_rad, 0.0
        self._look.begin()
        while (following := self._look.next_pose(self._reference, point_m)) is not None:
            turned_rad += abs(wrap_angle(following.yaw_rad - self._reference.yaw_rad))
            self._reference = following
            self._servo_period(following, forward=False)
            if abs(wrap_angle(following.yaw_rad - self._base.pose.yaw_rad)) > _TURN_LAG_RAD:
                break
        blocked = not self._settles(forward=False)
        if blocked:
            self._halt()
        end = self._base.pose
        moved_m = math.hypot(end.x_m - start.x_m, end.y_m - start.y_m)
        return MotionResult(
            blocked, self._mean_speeds(start_s, start_angles), moved_m, turned_rad, self._data.time - start_s
        )

    def _follow(self, action: Action) -> bool:
        """Move the reference through the action, and the base after it; True when something is in the way."""
        forward_m, turn_rad = action_motion(action)
        profile = action_profile(action, self._limits)
        start, start_s = self._reference, self._data.time
        self._reference = move_pose(start, forward_m, turn_rad)
        fraction = 0.0
        while fraction < 1.0:
            fraction = profile.fraction(self._data.time + self._config.servo_period_s - start_s)
            if self._servo_period(move_pose(start, forward_m * fraction, turn_rad * fraction), bool(forward_m)):
                return True
        return not self._settles(bool(forward_m))

    def _settles(self, forward: bool) -> bool:
        """Wait until the base stands at the reference; False if it does not get there."""
        config = self._config
        last_s = self._data.time + config.settle_s
        while True:
            at_rest = self._base.speed_mps < config.rest_mps and abs(self._base.turn_rate_radps) < config.rest_radps
            if at_rest and self._is_at_reference(config.settled_m, config.settled_rad):
                return True
            if self._data.time >= last_s:
                return self._is_at_reference(config.blocked_m, config.blocked_rad)
            if self._servo_period(self._reference, forward):
                return False

    def _servo_period(self, reference: Pose2, forward: bool) -> bool:
        """One command to the wheels and the substeps it holds for; True as soon as a forward move is in the way."""
        speeds = self._servo.wheel_speeds(self._base.pose, reference)
        self._data.ctrl[self._motors] = self._signs * (speeds.left_radps, speeds.right_radps)
        for _ in range(self._substeps):
            mujoco.mj_step(self._model, self._data)
            if forward and self._bumps():
                return True
        self._odometer.read(self._base.wheel_angles_rad)
        return False

    def _halt(self) -> None:
        """Brake until the base stands, and take that for where it should be."""
        self._data.ctrl[self._motors] = 0.0
        for _ in range(math.ceil(self._config.settle_s / self._config.servo_period_s)):
            mujoco.mj_step(self._model, self._data, nstep=self._substeps)
            self._odometer.read(self._base.wheel_angles_rad)
        self._reference, self._twist = self._base.pose, _STANDING

    def _mean_speeds(self, start_s: float, start_angles: Float[np.ndarray, "2"]) -> WheelSpeeds:
        """Mean speeds of the wheels since a time and angles before."""
        took_s = max(self._data.time - start_s, self._config.servo_period_s)
        speeds = (self._base.wheel_angles_rad - start_angles) / took_s
        return WheelSpeeds(float(speeds[0]), float(speeds[1]))

    def _possible(self, twist: Twist) -> Twist:
        """The same arc at a speed that wheels and limits allow, with some wheel speed left for the servo."""
        limits, speeds = self._limits, self._robot.wheel_speeds(twist.forward_mps, twist.turn_radps)
        wheel_radps = max(abs(speeds.left_radps), abs(speeds.right_radps))
        too_fast = max(
            abs(twist.forward_mps) / limits.forward_mps,
            abs(twist.turn_radps) / limits.turn_radps,
            wheel_radps / (0.95 * self._config.max_wheel_radps),
            1.0,
        )
        return Twist(twist.forward_mps / too_fast, twist.turn_radps / too_fast)

    def _nearer(self, wanted: Twist) -> Twist:
        """The velocity of the next servo period on the way to the one that is wanted."""
        period_s, limits, now = self._config.servo_period_s, self._limits, self._twist
        most_mps, most_radps = limits.forward_mps2 * period_s, limits.turn_radps2 * period_s
        return Twist(
            now.forward_mps + min(max(wanted.forward_mps - now.forward_mps, -most_mps), most_mps),
            now.turn_radps + min(max(wanted.turn_radps - now.turn_radps, -most_radps), most_radps),
        )

    def _braking_s(self) -> float:
        """Time until the base stands when it brakes now, with a period to spare [s]."""
        forward_s = abs(self._twist.forward_mps) / self._limits.forward_mps2
        return max(forward_s, abs(self._twist.turn_radps) / self._limits.turn_radps2) + self._config.servo_period_s

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
