"""A drive without physics: every action is executed exactly, or not at all."""

from __future__ import annotations

import mujoco

from anm_mj.control.clearance import Clearance
from anm_mj.control.motion import MotionLimits, action_motion, action_profile
from anm_mj.control.robot_model import RobotModel
from anm_mj.control.simulated_base import SimulatedBase
from anm_mj.types import Action, ActionResult, Pose2, WheelSpeeds


class KinematicDrive:
    """Moves the simulated base through wheel angles and forward kinematics, rolling without slip.

    A move that would touch something is refused as a whole: the robot stays where it is and does not slide along. The
    footprint is round about the point that the robot turns on, so a turn is never refused.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        robot: RobotModel,
        clearance: Clearance,
        limits: MotionLimits | None = None,
        prefix: str = "",
    ):
        """Drive ``data`` from where its base stands.

        Args:
            model: the robot, alone or in a scene.
            data: of that model.
            robot: its kinematics.
            clearance: of its footprint in the scene.
            limits: how fast the base would move; they decide about the simulated time alone.
            prefix: what the robot's names got before them when it was attached to the scene.

        Raises:
            RobotError: if the model lacks a joint of the robot.
        """
        self._data = data
        self._base = SimulatedBase(model, data, prefix)
        self._robot = robot
        self._clearance = clearance
        self._limits = limits or MotionLimits()

    @property
    def pose(self) -> Pose2:
        """Where the base stands now."""
        return self._base.pose

    def place(self, pose: Pose2) -> None:
        """Put the robot somewhere."""
        self._base.place(pose)

    def act(self, action: Action) -> ActionResult:
        """Execute an action at once; the simulated time moves on by what a real robot would take."""
        if action == Action.STOP:
            return ActionResult(action, collided=False, wheel_speeds=WheelSpeeds(0.0, 0.0), moved_m=0.0)
        pose = self._base.pose
        forward_m, turn_rad = action_motion(action)
        duration_s = action_profile(action, self._limits).duration_s
        self._data.time += duration_s
        if forward_m and self._clearance.sweep_collides(pose, forward_m):
            return ActionResult(action, collided=True, wheel_speeds=WheelSpeeds(0.0, 0.0), moved_m=0.0)

        # The profile scales the twist in time and never changes its direction, so the wheels turn at a constant ratio
        # and one exponential of the whole motion is exact.
        mean_speeds = self._robot.wheel_speeds(forward_m / duration_s, turn_rad / duration_s)
        left_rad, right_rad = mean_speeds.left_radps * duration_s, mean_speeds.right_radps * duration_s
        self._base.turn_wheels(left_rad, right_rad)
        self._base.place(self._robot.odometry(pose, left_rad, right_rad))
        return ActionResult(action, collided=False, wheel_speeds=mean_speeds, moved_m=forward_m)
