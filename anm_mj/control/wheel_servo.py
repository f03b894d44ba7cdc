"""Converts a reference pose to wheel speeds: one step of differential inverse kinematics by mink.

The task is to reach the reference within one period. Rolling without slip is an equality constraint; the highest wheel
speed and the distance to obstacles are inequality constraints.
"""

import logging
from typing import Any

import mink
import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.control.clearance_limit import ClearanceLimit, Obstacle, add_obstacles
from anm_mj.frames import pose_matrix
from anm_mj.robot.base_joints import PlanarBase, SimulatedBase
from anm_mj.robot.description import RobotDescription
from anm_mj.robot.kinematics import Kinematics, RobotKinematics
from anm_mj.robot.reduced_model import PLANAR_JOINTS, WHEEL_JOINTS
from anm_mj.types import Pose2

_logger = logging.getLogger(__name__)

SOLVER = "daqp"
_TASK_COST = 30.0
"""Weight of the pose task. Motions of one period are millimetres: at a weight of 1 the solver's regularisation lowers
the wheel speeds by a quarter of a percent; at this weight the loss vanishes."""


class NoSlip(mink.Task):
    """Rolling without slip: the wheels' Jacobian moves the base forward and in yaw, and nothing else moves it.

    As a constraint, its six rows are (twist of the base) - (twist from the wheels) = 0, in base axes.
    """

    def __init__(self, kinematics: RobotKinematics, model: mujoco.MjModel):
        """``model``: mink's, of the same robot."""
        super().__init__(cost=np.ones(6))
        self._wheels_to_twist = np.zeros((6, model.nv))
        wheel_dofs = [model.joint(name).dofadr[0] for name in WHEEL_JOINTS]
        self._wheels_to_twist[np.ix_([0, 5], wheel_dofs)] = kinematics.wheel_jacobian

    def compute_error(self, configuration: mink.Configuration) -> Float[np.ndarray, "6"]:
        """Zero: the constraint is on velocities only."""
        return np.zeros(6)

    def compute_jacobian(self, configuration: mink.Configuration) -> Float[np.ndarray, "6 nv"]:
        """Rows: linear velocity, then angular velocity, in base axes."""
        return configuration.get_frame_jacobian("base", "site") - self._wheels_to_twist


class BaseServo:
    """Inverse kinematics on mink's own model of the robot, apart from the simulated one."""

    def __init__(
        self,
        description: RobotDescription,
        kinematics: Kinematics,
        *,
        period_s: float,
        max_speeds: tuple[float, ...],
        obstacles: list[Obstacle] | None = None,
        min_distance_m: float = 0.0,
    ):
        """Set the problem up for a base that keeps ``min_distance_m`` from obstacles [m].

        ``period_s`` is the time between two calls [s]; ``max_speeds`` are the highest speeds of the left and the right
        wheel [rad/s], or of a holonomic base along x and y [m/s] and its highest turn rate [rad/s]. Raises RobotError
        if mink drops an obstacle.
        """
        spec = mujoco.MjSpec.from_string(description.reduced_mjcf)
        if obstacles:
            add_obstacles(spec, description, obstacles)
        self._model = spec.compile()
        self._period_s = period_s
        self._configuration = mink.Configuration(self._model)
        self._base: SimulatedBase | PlanarBase
        if isinstance(kinematics, RobotKinematics):
            joints = WHEEL_JOINTS
            self._base = SimulatedBase(self._model, self._configuration.data)
            self._constraints = [NoSlip(kinematics, self._model)]
        else:
            joints, self._constraints = PLANAR_JOINTS, None
            self._base = PlanarBase(self._model, self._configuration.data, "", joints)
        self._dofs = [self._model.joint(name).dofadr[0] for name in joints]
        # Height and tilt follow from the no-slip rows; a cost on them would only add rounding errors.
        self._reach = mink.FrameTask(
            "base", "site", position_cost=[_TASK_COST, _TASK_COST, 0.0], orientation_cost=[0.0, 0.0, _TASK_COST]
        )
        speeds: dict[str, Any] = dict(zip(joints, max_speeds, strict=True))
        self._limits: list[mink.Limit] = [mink.VelocityLimit(self._model, speeds)]
        self._clearance: ClearanceLimit | None = None
        if obstacles:
            self._clearance = ClearanceLimit(self._model, len(obstacles), min_distance_m=min_distance_m)
            self._limits.append(self._clearance)

    @property
    def is_near_obstacle(self) -> bool:
        """Whether an obstacle was within centimetres of the body at the last call."""
        return self._clearance is not None and self._clearance.is_active

    def speeds(self, pose: Pose2, reference: Pose2) -> Float[np.ndarray, " n"]:
        """Speeds, as ``max_speeds``, that bring the base as near to the reference as possible within one period.

        Zero if the solver finds no solution.
        """
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
                constraints=self._constraints,
            )
        except mink.NoSolutionFound:
            # Standing still satisfies every limit, so a solution exists; the solver can miss it after a push into
            # several obstacles at once.
            _logger.debug("No wheel speeds found at %s for %s; the wheels stop for one period", pose, reference)
            return np.zeros(len(self._dofs))
        return np.asarray(velocity)[self._dofs]
