"""Turns the robot on the spot until its camera faces a point: mink's look-at task under the wheel limits."""

import math

import mink
import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.control.speed_and_acceleration import MotionLimits
from anm_mj.control.wheel_servo import SOLVER, NoSlip
from anm_mj.errors import RobotError
from anm_mj.frames import move_pose, wrap_angle
from anm_mj.robot.base_joints import SimulatedBase
from anm_mj.robot.description import RobotDescription
from anm_mj.robot.kinematics import Kinematics, PlanarKinematics, RobotKinematics
from anm_mj.robot.reduced_model import CAMERA, WHEEL_JOINTS
from anm_mj.types import Pose2

_TASK_COST = 10.0
_ALIGNED_RAD = math.radians(0.01)
_ABOVE_M = 1e-6
"""A point no farther than this beside the camera is above or below it [m]."""
_FAR_SIDE_RAD = math.radians(120.0)
"""Beyond this angle the task has no preferred side; it first targets a point at a right angle."""
_FAR_M = 1e4
"""How far away the point lies that the task looks at [m]."""


class _TurnOnly(mink.Task):
    """As a constraint: left + right = 0, so the wheels counter-rotate."""

    def __init__(self, model: mujoco.MjModel):
        super().__init__(cost=np.ones(1))
        self._row = np.zeros((1, model.nv))
        self._row[0, [model.joint(name).dofadr[0] for name in WHEEL_JOINTS]] = 1.0

    def compute_error(self, configuration: mink.Configuration) -> Float[np.ndarray, "1"]:
        return np.zeros(1)

    def compute_jacobian(self, configuration: mink.Configuration) -> Float[np.ndarray, "1 nv"]:
        return self._row


class LookAt:
    """Generates the pose of the base for each servo period while it turns towards a point.

    The camera is fixed to the base, so a turn can only bring the point and the camera's axis into one vertical plane.
    The turn obeys the limits of a discrete turn: speed, acceleration and deceleration.
    """

    def __init__(
        self, description: RobotDescription, kinematics: RobotKinematics, limits: MotionLimits, *, period_s: float
    ) -> None:
        """Set the problem up; ``period_s`` is the time between two poses [s]."""
        model = mujoco.MjModel.from_xml_string(description.reduced_mjcf)
        self._model, self._limits, self._period_s = model, limits, period_s
        self._kinematics: Kinematics = kinematics
        self._wheels = kinematics
        self._configuration = mink.Configuration(model)
        self._base = SimulatedBase(model, self._configuration.data)
        self._left_dof = model.joint(WHEEL_JOINTS[0]).dofadr[0]
        self._task = mink.LookAtTask(CAMERA, "site", axis=(0.0, 0.0, 1.0), cost=_TASK_COST)
        self._constraints = [NoSlip(kinematics, model), _TurnOnly(model)]
        self._turn_radps = 0.0

    def reset(self) -> None:
        """Start from rest."""
        self._turn_radps = 0.0

    def next_pose(self, pose: Pose2, point_m: Float[np.ndarray, "3"]) -> Pose2 | None:
        """Pose of the base one period after a pose; None once the camera faces the point of the world [m]. Raises
        RobotError as :meth:`turn_rad`.
        """
        if abs(self.error_rad(pose, point_m)) < _ALIGNED_RAD:
            return None
        # Not the angle that the camera sees: a camera ahead of the axis would overshoot a near point for ever.
        turn_rad = self.turn_rad(pose, point_m)
        self._base.place(pose)
        self._configuration.update()
        self._task.set_target(self._target(pose, turn_rad))
        wheel_radps = self._wheels.wheel_motion(0.0, self._allowed_radps(turn_rad))[1]
        velocity = mink.solve_ik(
            self._configuration,
            [self._task],
            self._period_s,
            SOLVER,
            limits=[mink.VelocityLimit(self._model, dict.fromkeys(WHEEL_JOINTS, wheel_radps))],
            constraints=self._constraints,
        )
        left = float(velocity[self._left_dof])
        self._turn_radps = self._wheels.body_motion(left, -left)[1]
        return move_pose(pose, 0.0, self._turn_radps * self._period_s)

    def _allowed_radps(self, turn_rad: float) -> float:
        """Highest turn rate within the limits of speed, acceleration and braking [rad/s]."""
        braking_radps = math.sqrt(2.0 * self._limits.turn_radps2 * abs(turn_rad))
        faster_radps = abs(self._turn_radps) + self._limits.turn_radps2 * self._period_s
        return min(self._limits.turn_radps, faster_radps, braking_radps)

    def error_rad(self, pose: Pose2, point_m: Float[np.ndarray, "3"]) -> float:
        """Horizontal angle from the camera's axis to the point [rad]; 0 for a point above or below the camera."""
        T_world_camera = self._kinematics.T_world_camera(pose)
        x, y = point_m[:2] - T_world_camera[:2, 3]
        if math.hypot(x, y) < _ABOVE_M:
            return 0.0
        return wrap_angle(math.atan2(y, x) - math.atan2(T_world_camera[1, 2], T_world_camera[0, 2]))

    def turn_rad(self, pose: Pose2, point_m: Float[np.ndarray, "3"]) -> float:
        """Turn of the base on the spot after which the camera faces a point of the world [m], to the left [rad].

        The camera moves with the turn: its axis passes the axis of rotation at a fixed distance, and the camera stands
        a fixed distance along it. Raises RobotError where no turn does: the point lies nearer to the axis of rotation
        than the camera's axis passes it, or always behind the camera.
        """
        T_base_camera = self._kinematics.T_base_camera
        x, y = point_m[:2] - pose.xy_m
        camera_x, camera_y = T_base_camera[:2, 3]
        axis_rad = math.atan2(T_base_camera[1, 2], T_base_camera[0, 2])
        camera_along_m = camera_x * math.cos(axis_rad) + camera_y * math.sin(axis_rad)
        aside_m = camera_y * math.cos(axis_rad) - camera_x * math.sin(axis_rad)
        away_m, camera_m = math.hypot(x, y), math.hypot(camera_x, camera_y)
        along_m = math.sqrt(max(away_m**2 - aside_m**2, 0.0))
        if away_m < abs(aside_m) or along_m < camera_along_m + _ABOVE_M:
            raise RobotError(
                f"No turn on the spot makes the camera face {np.round(point_m, 3).tolist()}: the point is "
                f"{away_m:.3g} m from the robot's axis of rotation, and the camera {camera_m:.3g} m; give a point "
                "farther away than the camera, or move the robot first."
            )
        return wrap_angle(math.atan2(y, x) - pose.yaw_rad - axis_rad - math.atan2(aside_m, along_m))

    def _target(self, pose: Pose2, turn_rad: float) -> Float[np.ndarray, "3"]:
        """A point at the camera's height where its axis leads after a turn; for one behind, at a right angle on the
        nearer side. It is so far away that the camera's own motion in the turn does not matter.
        """
        # A turn changes no elevation. Given one, the task would overshoot for points high up or far down.
        T_world_camera = self._kinematics.T_world_camera(pose)
        towards = turn_rad if abs(turn_rad) < _FAR_SIDE_RAD else math.copysign(math.pi / 2, turn_rad)
        yaw = math.atan2(T_world_camera[1, 2], T_world_camera[0, 2]) + towards
        return T_world_camera[:3, 3] + _FAR_M * np.array([math.cos(yaw), math.sin(yaw), 0.0])


class PlanarLookAt(LookAt):
    """The same for a holonomic base, which turns about its own axis."""

    def __init__(self, kinematics: PlanarKinematics, limits: MotionLimits, *, period_s: float) -> None:
        self._kinematics, self._limits, self._period_s = kinematics, limits, period_s
        self._turn_radps = 0.0

    def next_pose(self, pose: Pose2, point_m: Float[np.ndarray, "3"]) -> Pose2 | None:
        """Pose of the base one period later; None once the camera faces the point. Raises RobotError as
        :meth:`turn_rad`.
        """
        if abs(self.error_rad(pose, point_m)) < _ALIGNED_RAD:
            return None
        turn_rad = self.turn_rad(pose, point_m)
        rate = min(self._allowed_radps(turn_rad), abs(turn_rad) / self._period_s)
        self._turn_radps = math.copysign(rate, turn_rad)
        return move_pose(pose, 0.0, self._turn_radps * self._period_s)
