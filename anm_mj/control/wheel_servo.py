"""From where the base should be next to wheel speeds: one step of differential inverse kinematics by mink.

The base is asked to reach a pose within one period; that it rolls and does not slip is an equality that always holds,
the wheels' highest speed and the distance to obstacles are inequalities.
"""

from __future__ import annotations

import logging

import mink
import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.control.clearance_limit import ClearanceLimit, Obstacle, add_obstacles
from anm_mj.control.simulated_base import SimulatedBase
from anm_mj.frames import pose_matrix
from anm_mj.robot.description import RobotDescription
from anm_mj.robot.kinematics import WHEEL_JOINTS, RobotKinematics
from anm_mj.types import Pose2, WheelSpeeds

_logger = logging.getLogger(__name__)

SOLVER = "daqp"
_TASK_COST = 30.0
"""Weight of the pose that is asked for. Motions of one period are small (mm), so at a weight of 1 the solver's own
regularisation takes a quarter of a percent off the wheel speeds; at this weight it takes nothing."""


class NoSlip(mink.Task):
    """The base moves as its wheels roll: forward and in yaw by their Jacobian, in no other direction.

    Passed to mink as a constraint, its six rows are (twist of the base) - (twist from the wheels) = 0, in base axes.
    """

    def __init__(self, robot: RobotKinematics, model: mujoco.MjModel):
        """For mink's model of the robot."""
        super().__init__(cost=np.ones(6))
        self._wheels_to_twist = np.zeros((6, model.nv))
        wheel_dofs = [model.joint(name).dofadr[0] for name in WHEEL_JOINTS]
        self._wheels_to_twist[np.ix_([0, 5], wheel_dofs)] = robot.wheel_jacobian

    def compute_error(self, configuration: mink.Configuration) -> Float[np.ndarray, "6"]:
        """Zero: only velocities are constrained."""
        return np.zeros(6)

    def compute_jacobian(self, configuration: mink.Configuration) -> Float[np.ndarray, "6 nv"]:
        """Rows: linear velocity, then angular velocity, in base axes."""
        return configuration.get_frame_jacobian("base", "site") - self._wheels_to_twist


class WheelServo:
    """Computes wheel speeds; holds mink's own model of the robot, apart from the simulated one."""

    def __init__(
        self,
        description: RobotDescription,
        robot: RobotKinematics,
        *,
        period_s: float,
        max_wheel_radps: float,
        obstacles: list[Obstacle] | None = None,
        keep_m: float = 0.0,
    ):
        """Set the problem up.

        Args:
            description: the robot.
            robot: its kinematics.
            period_s: time from one call to the next [s].
            max_wheel_radps: neither wheel is asked to turn faster [rad/s].
            obstacles: what the robot's body keeps clear of; nothing when None.
            keep_m: the distance that it keeps [m].

        Raises:
            RobotError: if mink drops an obstacle.
        """
        spec = mujoco.MjSpec.from_string(description.skeleton)
        if obstacles:
            add_obstacles(spec, description, obstacles)
        model = spec.compile()
        self._period_s = period_s
        self._configuration = mink.Configuration(model)
        self._base = SimulatedBase(model, self._configuration.data)
        self._wheel_dofs = [model.joint(name).dofadr[0] for name in WHEEL_JOINTS]
        # Heights and tilts follow from the no-slip rows; asking for them as well would only add rounding.
        self._reach = mink.FrameTask(
            "base",
            "site",
            position_cost=[_TASK_COST, _TASK_COST, 0.0],
            orientation_cost=[0.0, 0.0, _TASK_COST],
        )
        self._no_slip = NoSlip(robot, model)
        self._limits: list[mink.Limit] = [mink.VelocityLimit(model, dict.fromkeys(WHEEL_JOINTS, max_wheel_radps))]
        if obstacles:
            self._limits.append(ClearanceLimit(model, len(obstacles), keep_m=keep_m))

    def wheel_speeds(self, pose: Pose2, reference: Pose2) -> WheelSpeeds:
        """Wheel speeds that bring the base as near to the reference as possible within one period."""
        self._base.place(pose)
        self._configuration.update()
        self._reach.set_target(mink.SE3.from_matrix(pose_matrix(reference)))
        try:
            velocity = mink.solve_ik(
                self._configuration,
                [self._reach],
                self._period_s,
                SOLVER,
                limits=self._limits,
                constraints=[self._no_slip],
            )
        except mink.NoSolutionFound:
            # Standing still keeps every limit, so there always is a solution; the solver may miss it where a push has
            # pressed the robot into several obstacles at once.
            _logger.debug("no wheel speeds found at %s for %s; the wheels stand for a period", pose, reference)
            return WheelSpeeds(0.0, 0.0)
        left, right = velocity[self._wheel_dofs].tolist()
        return WheelSpeeds(left, right)
