"""Turning on the spot until the camera looks at a point: mink's look-at task under the wheels' limits."""

from __future__ import annotations

import math

import mink
import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.control.motion import MotionLimits
from anm_mj.control.simulated_base import SimulatedBase
from anm_mj.control.wheel_servo import SOLVER, NoSlip
from anm_mj.frames import move_pose, wrap_angle
from anm_mj.robot.description import RobotDescription
from anm_mj.robot.kinematics import CAMERA, WHEEL_JOINTS, RobotKinematics
from anm_mj.types import Pose2

_TASK_COST = 10.0
_ALIGNED_RAD = math.radians(0.01)
_FAR_SIDE_RAD = math.radians(120.0)
"""A point farther behind than this gives the task no side to turn to: first comes a point at a right angle."""


class _TurnOnly(mink.Task):
    """The two wheels turn against each other. As a constraint: (left + right) = 0."""

    def __init__(self, model: mujoco.MjModel):
        super().__init__(cost=np.ones(1))
        self._row = np.zeros((1, model.nv))
        self._row[0, [model.joint(name).dofadr[0] for name in WHEEL_JOINTS]] = 1.0

    def compute_error(self, configuration: mink.Configuration) -> Float[np.ndarray, "1"]:
        return np.zeros(1)

    def compute_jacobian(self, configuration: mink.Configuration) -> Float[np.ndarray, "1 nv"]:
        return self._row


class LookAt:
    """Where the base is to be from one servo period to the next while it turns to a point.

    The camera is fixed to the base, so what can be reached is that the point and the camera's axis lie in one vertical
    plane. The turn keeps to the limits of a discrete turn: its speed, its acceleration, and its braking.
    """

    def __init__(
        self, description: RobotDescription, robot: RobotKinematics, limits: MotionLimits, *, period_s: float
    ) -> None:
        """Set the problem up.

        Args:
            description: the robot.
            robot: its kinematics.
            limits: how fast it turns.
            period_s: time from one pose to the next [s].
        """
        model = mujoco.MjModel.from_xml_string(description.skeleton)
        self._model, self._robot, self._limits, self._period_s = model, robot, limits, period_s
        self._configuration = mink.Configuration(model)
        self._base = SimulatedBase(model, self._configuration.data)
        self._left_dof = model.joint(WHEEL_JOINTS[0]).dofadr[0]
        self._task = mink.LookAtTask(CAMERA, "site", axis=(0.0, 0.0, 1.0), cost=_TASK_COST)
        self._constraints = [NoSlip(robot, model), _TurnOnly(model)]
        self._turn_radps = 0.0

    def begin(self) -> None:
        """The base stands."""
        self._turn_radps = 0.0

    def next_pose(self, pose: Pose2, point_m: Float[np.ndarray, "3"]) -> Pose2 | None:
        """Where the base is to be one period later; None when it looks at the point.

        Args:
            pose: where it is.
            point_m: in the world.
        """
        error_rad = self.error_rad(pose, point_m)
        if abs(error_rad) < _ALIGNED_RAD:
            return None
        self._base.place(pose)
        self._configuration.update()
        self._task.set_target(self._target(pose, point_m, error_rad))
        braking_radps = math.sqrt(2.0 * self._limits.turn_radps2 * abs(error_rad))
        faster_radps = abs(self._turn_radps) + self._limits.turn_radps2 * self._period_s
        allowed_radps = min(self._limits.turn_radps, faster_radps, braking_radps)
        wheel_radps = self._robot.wheel_motion(0.0, allowed_radps)[1]
        velocity = mink.solve_ik(
            self._configuration,
            [self._task],
            self._period_s,
            SOLVER,
            limits=[mink.VelocityLimit(self._model, dict.fromkeys(WHEEL_JOINTS, wheel_radps))],
            constraints=self._constraints,
        )
        left = float(velocity[self._left_dof])
        self._turn_radps = self._robot.body_motion(left, -left)[1]
        return move_pose(pose, 0.0, self._turn_radps * self._period_s)

    def error_rad(self, pose: Pose2, point_m: Float[np.ndarray, "3"]) -> float:
        """Angle in the plane from the camera's axis to the point [rad]; 0 for a point above or below the camera."""
        T_world_camera = self._robot.T_world_camera(pose)
        x, y = point_m[:2] - T_world_camera[:2, 3]
        if math.hypot(x, y) < 1e-6:
            return 0.0
        return wrap_angle(math.atan2(y, x) - math.atan2(T_world_camera[1, 2], T_world_camera[0, 2]))

    def _target(self, pose: Pose2, point_m: Float[np.ndarray, "3"], error_rad: float) -> Float[np.ndarray, "3"]:
        """The point at the camera's height, or one a right angle to the side that it is to be reached over."""
        T_world_camera = self._robot.T_world_camera(pose)
        if abs(error_rad) < _FAR_SIDE_RAD:
            # Turning changes no elevation: asked for one too, the task would turn too far for points high up or low.
            return np.array([point_m[0], point_m[1], T_world_camera[2, 3]])
        to_the_right = T_world_camera[:3, 0]
        return T_world_camera[:3, 3] - math.copysign(1.0, error_rad) * to_the_right
