"""A drive by wheel torque and contact: the wheels move the base, and obstacles stop it."""

from __future__ import annotations

import copy
import math
from dataclasses import replace

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.control.action_motion import action_motion, action_profile
from anm_mj.control.clearance_limit import static_obstacles
from anm_mj.control.speed_and_acceleration import limits_of, slewed
from anm_mj.control.wheel_servo import BaseServo
from anm_mj.frames import move_pose, relative_pose, wrap_angle
from anm_mj.localisation.odometry import Odometer
from anm_mj.mjcf.read_mjcf import log_warnings
from anm_mj.robot.base_joints import element_id
from anm_mj.robot.description import RobotDescription
from anm_mj.robot.kinematics import PlanarKinematics
from anm_mj.robot.servos import SUBSTEP_S
from anm_mj.sim.drives.repeated_failures import RepeatedFailures
from anm_mj.sim.drives.shell_contacts import ShellContacts
from anm_mj.sim.drives.wheel_drive import STILL, WheelDrive, require_motion
from anm_mj.types import TURN_STEP_RAD, Action, ActionResult, MotionResult, Pose2, StopReason, Twist

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
_STANDING = Twist(0.0, 0.0)
UNSTABLE = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
_UNSTABLE = np.array([int(kind) for kind in UNSTABLE])
_TURN_LAG_RAD = math.radians(5.0)
"""A turning reference waits for a robot that lags it by more: its wheels slip, or it is held fast."""
_SUBSTEPS = 10
"""Physics steps between two commands to the wheels."""
_MAX_WHEEL_RADPS = 12.0
_KEEP_CLEAR_M = 0.005
"""Distance to the obstacle boxes at which the servo stops the robot's body [m]."""
_SETTLE_S = 0.3
"""Longest time from the planned end of an action until the base rests at the reference [s]."""
_SETTLED_M, _SETTLED_RAD = 0.0005, math.radians(0.02)
"""An action is done this near to the reference, along the heading [m] and in angle [rad]."""
_REST_MPS, _REST_RADPS = 0.005, 0.02
"""Below this speed [m/s] and turn rate [rad/s] the base is at rest."""
_BLOCKED_M, _BLOCKED_RAD = 0.005, math.radians(0.5)
"""Farther from the reference after settling, along the heading [m] or in angle [rad], the base has collided."""
_LAG_M = 0.02
"""A larger distance to the reference while driving at a velocity means a collision or a push [m]."""
_PUSHED_M = 0.005
"""A larger sideways distance to the reference means a push from the side [m]."""
_MET_M = 0.03
"""A collision nearer than this to a person is one with them [m]."""
_TOPPLED_RAD = math.radians(30.0)
"""A base that tilts by more has fallen over [rad]."""


class PhysicsDrive(WheelDrive):
    """Executes motions by a servo on the true pose of the base.

    The servo follows a reference pose. The reference carries over from motion to motion, so errors of single actions do
    not add up. After a collision, or a push from the side, it restarts at the true pose.
    """

    REBUILT = ("_model", "_servo", "_contacts")

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        description: RobotDescription,
        odometer: Odometer | None = None,
        prefix: str = "",
    ):
        """Arguments are those of :class:`WheelDrive`; sets the model's time step, integrator and friction cone.

        The model's static geoms are the obstacles that the servo keeps clear of. Raises RobotError if the model lacks a
        joint, an actuator or a geom of the robot, or mink drops an obstacle.
        """
        self._model = model
        self._max_wheel_radps = min(_MAX_WHEEL_RADPS, description.max_wheel_radps)
        limits = limits_of(description, self._max_wheel_radps)
        super().__init__(model, data, description, limits, odometer, prefix, period_s=_SUBSTEPS * SUBSTEP_S)
        planar_speeds = (2.0 * self._limits.forward_mps,) * 2 + (2.0 * self._limits.turn_radps,)
        is_planar = isinstance(self._kinematics, PlanarKinematics)
        self._servo = BaseServo(
            description,
            self._kinematics,
            period_s=self._period_s,
            max_speeds=planar_speeds if is_planar else (self._max_wheel_radps,) * 2,
            obstacles=static_obstacles(model),
            min_distance_m=_KEEP_CLEAR_M,
        )
        self._signs = np.array(description.wheel_signs or (1.0,) * len(description.motors))
        self._touched = False
        self._traction = RepeatedFailures()
        motors = [element_id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, prefix + name) for name in description.motors]
        self._motors = np.array(motors)
        self._contacts = ShellContacts(model, data, [prefix + name for name in description.shell])
        self._reference = self._base.pose
        self._twist = _STANDING

        # Where the simulation diverges, the run says so.
        log_warnings()
        model.opt.timestep = SUBSTEP_S
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC

    @property
    def data(self) -> mujoco.MjData:
        """The simulation that it drives in."""
        return self._data

    def take_over(self, other: PhysicsDrive) -> None:
        """Go on from where another drive of the same robot in the same model is, and share nothing that changes."""
        mujoco.mj_copyData(self._data, self._model, other._data)
        self._reference, self._twist, self._touched = other._reference, other._twist, other._touched
        self._odometer, self._traction = other._odometer.copied(), copy.deepcopy(other._traction)
        self._crowd, self._figures = other._crowd and other._crowd.copied(), other._figures
        self._trail = other._trail and other._trail.copied()

    @property
    def state(self) -> bytes:
        """Of simulation and drive: two that are equal have the same future, but for noise of another seed."""
        state = np.empty(mujoco.mj_stateSize(self._model, _STATE))
        mujoco.mj_getState(self._model, self._data, state, _STATE)
        return state.tobytes() + repr((self._reference, self._twist, self.odometry)).encode()

    def place(self, pose: Pose2) -> None:
        """Move the robot to a pose without driving, at rest, and restart its odometry there."""
        self._base.place(pose)
        self._data.qvel[:] = 0.0
        self._data.ctrl[self._motors] = 0.0
        self._reference, self._twist = pose, _STANDING
        self._traction = RepeatedFailures()
        self._odometer.reset(pose, self._base.wheel_angles_rad)

    def act(self, action: Action) -> ActionResult:
        """Execute an action until the robot rests at the commanded pose or an obstacle stops it."""
        self._brake()
        if action == Action.STOP:
            return ActionResult(action, collided=False, wheel_speeds=STILL, moved_m=0.0)
        start, start_s, start_angles = self._base.pose, self._data.time, self._base.wheel_angles_rad
        self._touched = False
        collided = self._execute(action)
        off_m = abs(relative_pose(self._base.pose, self._reference).y_m)
        if collided:
            self._halt()
        # No wheel can undo a push from the side, and after the next turn the servo would drive it as a distance.
        elif off_m > _PUSHED_M:
            self._reference = self._base.pose
        end = self._base.pose
        return ActionResult(
            action,
            collided=collided,
            wheel_speeds=self._mean_speeds(start_s, start_angles),
            moved_m=math.dist(start.xy_m, end.xy_m),
            met_person=collided and self._crowd is not None and self._crowd.distance_m(end.xy_m) < _MET_M,
            fault=self._fault(
                failed=collided or off_m > _PUSHED_M,
                driven_rad=self._kinematics.wheel_motion(*action_motion(action)),
                turned_rad=self._turned_rad(start_angles),
            ),
        )

    def _fault(
        self,
        *,
        failed: bool,
        driven_rad: tuple[float, float],
        turned_rad: tuple[float, float],
        least_rad: float = 0.0,
    ) -> StopReason | None:
        """Why the robot can drive no more after a motion, which ``failed`` if it ended away from where it should; the
        others are as of :meth:`RepeatedFailures.after`.
        """
        if self._diverged:
            return StopReason.DIVERGED
        if self._base.tilt_rad > _TOPPLED_RAD:
            return StopReason.TOPPLED
        touched = self._touched or self._contacts.any() or self._servo.is_near_obstacle
        return self._traction.after(
            failed=failed, touched=touched, driven_rad=driven_rad, turned_rad=turned_rad, least_rad=least_rad
        )

    def _fault_of_part(
        self, failed: bool, forward_m: float, turn_rad: float, start_angles_rad: Float[np.ndarray, " n"]
    ) -> StopReason | None:
        """As :meth:`_fault`, after a motion of the reference that may be any part of an action, or several."""
        return self._fault(
            failed=failed,
            driven_rad=self._kinematics.wheel_motion(forward_m, turn_rad),
            turned_rad=self._turned_rad(start_angles_rad),
            least_rad=self._kinematics.wheel_motion(0.0, TURN_STEP_RAD)[1],
        )

    def drive(self, twist: Twist, duration_s: float) -> MotionResult:
        """Move at a velocity for a time [s], rounded up to servo periods.

        The velocity changes at the accelerations of the limits; one beyond the wheels' limits is scaled down along the
        same arc. Afterwards the robot may still move: the next call of ``drive`` continues from there, and an action
        first brings it to rest. Raises RobotError if the duration is not positive, or the velocity not finite.
        """
        require_motion(twist, duration_s)
        period_s, wanted = self._period_s, self._saturate(twist)
        start_s, start_angles, moved_m, turned_rad = self._data.time, self._base.wheel_angles_rad, 0.0, 0.0
        collided = self._touched = False
        asked_m = asked_rad = 0.0
        for _ in range(math.ceil(duration_s / period_s - 1e-9)):
            before = self._base.pose
            self._twist = slewed(self._twist, wanted, self._limits, period_s)
            forward_m, turn_rad = self._twist.forward_mps * period_s, self._twist.turn_radps * period_s
            self._reference = move_pose(self._reference, forward_m, turn_rad)
            asked_m, asked_rad = asked_m + forward_m, asked_rad + turn_rad
            collided = self._servo_period(self._reference, self._twist.forward_mps > 0.0)
            after = self._base.pose
            lag_rad = wrap_angle(self._reference.yaw_rad - after.yaw_rad)
            if abs(lag_rad) > _TURN_LAG_RAD:
                # Else the next motion would begin with the turn that is missing, or with one the other way round.
                yaw_rad = wrap_angle(after.yaw_rad + math.copysign(_TURN_LAG_RAD, lag_rad))
                self._reference = replace(self._reference, yaw_rad=yaw_rad)
            moved_m += math.dist(before.xy_m, after.xy_m)
            turned_rad += abs(wrap_angle(after.yaw_rad - before.yaw_rad))
            if collided or math.dist(self._base.pose.xy_m, self._reference.xy_m) > _LAG_M:
                collided = True
                self._halt()
                break
        speeds = self._mean_speeds(start_s, start_angles)
        fault = self._fault_of_part(collided, asked_m, asked_rad, start_angles)
        return MotionResult(collided, speeds, moved_m, turned_rad, self._data.time - start_s, fault)

    def look_at(self, point_m: Float[np.ndarray, "3"]) -> MotionResult:
        """Turn on the spot until the camera's axis and a point of the world share a vertical plane. Raises RobotError,
        with the robot at rest, where no turn brings this about: as :meth:`LookAt.turn_rad`.
        """
        self._brake()
        controller, turned_rad, self._touched = self._look_at_controller(), 0.0, False
        collided = False
        start, start_s, start_angles = self._base.pose, self._data.time, self._base.wheel_angles_rad
        while not collided and (following := controller.next_pose(self._reference, point_m)) is not None:
            turned_rad += abs(wrap_angle(following.yaw_rad - self._reference.yaw_rad))
            self._reference = following
            self._servo_period(following, forward=False)
            if abs(wrap_angle(following.yaw_rad - self._base.pose.yaw_rad)) > _TURN_LAG_RAD:
                collided = not self._settle(forward=False)
        collided = collided or not self._settle(forward=False)
        if collided:
            self._halt()
        moved_m, speeds = math.dist(start.xy_m, self._base.pose.xy_m), self._mean_speeds(start_s, start_angles)
        fault = self._fault_of_part(collided, 0.0, turned_rad, start_angles)
        return MotionResult(collided, speeds, moved_m, turned_rad, self._data.time - start_s, fault)

    def _execute(self, action: Action) -> bool:
        """Move the reference through the action and the base after it; True if something is in the way."""
        forward_m, turn_rad = action_motion(action)
        profile = action_profile(action, self._limits)
        start, start_s = self._reference, self._data.time
        self._reference = move_pose(start, forward_m, turn_rad)
        fraction = 0.0
        while fraction < 1.0:
            fraction = profile.fraction(self._data.time + self._period_s - start_s)
            if self._servo_period(move_pose(start, forward_m * fraction, turn_rad * fraction), bool(forward_m)):
                return True
        return not self._settle(bool(forward_m))

    def _settle(self, forward: bool) -> bool:
        """Wait until the base rests at the reference; False if it does not arrive."""
        last_s = self._data.time + _SETTLE_S
        while True:
            at_rest = self._base.speed_mps < _REST_MPS and abs(self._base.turn_rate_radps) < _REST_RADPS
            if at_rest and self._is_at_reference(_SETTLED_M, _SETTLED_RAD):
                return True
            if self._data.time >= last_s:
                return self._is_at_reference(_BLOCKED_M, _BLOCKED_RAD)
            if self._servo_period(self._reference, forward):
                return False

    def _servo_period(self, reference: Pose2, forward: bool) -> bool:
        """Command the wheels for one period; True once a contact blocks a forward motion, or it diverges."""
        # The wheels of a side turn alike.
        speeds = self._servo.speeds(self._base.pose, reference)
        self._data.ctrl[self._motors] = self._signs * np.repeat(speeds, len(self._signs) // len(speeds))
        self._touched |= self._servo.is_near_obstacle
        self._pass_time()
        self._note()
        for _ in range(_SUBSTEPS):
            mujoco.mj_step(self._model, self._data)
            if forward and self._contacts.blocks(self._base):
                return True
        self._odometer.update(self._base.wheel_angles_rad)
        # MuJoCo has reset the simulation and its clock, so that no motion would ever end.
        return self._diverged

    @property
    def _diverged(self) -> bool:
        return bool(self._data.warning.number[_UNSTABLE].any()) or not np.isfinite(self._data.qpos).all()

    def _halt(self) -> None:
        self._data.ctrl[self._motors] = 0.0
        for _ in range(math.ceil(_SETTLE_S / self._period_s)):
            self._pass_time()
            self._note()
            mujoco.mj_step(self._model, self._data, nstep=_SUBSTEPS)
            self._odometer.update(self._base.wheel_angles_rad)
        self._reference, self._twist = self._base.pose, _STANDING

    def _saturate(self, twist: Twist) -> Twist:
        """The same arc within the limits of base and wheels, with a reserve of wheel speed for the servo."""
        limits, speeds = self._limits, self._kinematics.wheel_speeds(twist.forward_mps, twist.turn_radps)
        wheel_radps = max(abs(speeds.left_radps), abs(speeds.right_radps))
        too_fast = max(
            abs(twist.forward_mps) / limits.forward_mps,
            abs(twist.turn_radps) / limits.turn_radps,
            wheel_radps / (0.95 * self._max_wheel_radps),
            1.0,
        )
        return Twist(twist.forward_mps / too_fast, twist.turn_radps / too_fast)

    def _brake(self) -> None:
        """Brake a base in motion to rest; the time includes one period in reserve."""
        if self._twist == _STANDING:
            return
        forward_s = abs(self._twist.forward_mps) / self._limits.forward_mps2
        turn_s = abs(self._twist.turn_radps) / self._limits.turn_radps2
        self.drive(_STANDING, max(forward_s, turn_s) + self._period_s)

    def _is_at_reference(self, along_m: float, angle_rad: float) -> bool:
        """Whether the base is at the reference, apart from the sideways offset that no wheel can undo."""
        offset = relative_pose(self._base.pose, self._reference)
        return abs(offset.x_m) < along_m and abs(offset.yaw_rad) < angle_rad
