"""A drive without physics: it executes a motion exactly or refuses it."""

import math
from collections.abc import Sequence
from itertools import pairwise

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.control.action_motion import Trapezoid, action_motion, action_profile
from anm_mj.control.speed_and_acceleration import MotionLimits
from anm_mj.frames import move_pose
from anm_mj.geometry.clearance import Clearance
from anm_mj.localisation.odometry import Odometer
from anm_mj.robot.base_joints import PlanarBase, SimulatedBase, simulated_base
from anm_mj.robot.description import RobotDescription
from anm_mj.robot.kinematics import PlanarKinematics
from anm_mj.sim.drives.wheel_drive import STILL, WheelDrive, require_motion
from anm_mj.types import Action, ActionResult, MotionResult, Pose2, Twist

_LOOK_PERIOD_S = 0.02
_CHORD_RAD = 0.2
"""People and doors are looked for on straight lines with at most this turn between two."""


class KinematicDrive(WheelDrive):
    """Turns the wheels and moves the base by forward kinematics of rolling without slip.

    It refuses a motion that would touch something: the robot stays and does not slide along the obstacle. The footprint
    is a circle about the axis of rotation, so a turn on the spot always succeeds.
    """

    REBUILT = ("_clearance", "_model", "_prefix", "_ahead")

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        description: RobotDescription,
        clearance: Clearance,
        odometer: Odometer | None = None,
        prefix: str = "",
    ):
        """Arguments are those of :class:`WheelDrive`; ``clearance`` is that of the footprint in the scene. Raises
        RobotError if the model lacks a joint of the robot.
        """
        # The limits only set the simulated time.
        super().__init__(model, data, description, MotionLimits(), odometer, prefix, period_s=_LOOK_PERIOD_S)
        self._clearance = clearance
        self._met_person = False
        self._model, self._prefix = model, prefix
        self._ahead: list[tuple[mujoco.MjData, SimulatedBase | PlanarBase]] = []
        """The base in other data, wherever it was asked for."""

    def place(self, pose: Pose2) -> None:
        """Move the robot to a pose without driving, and restart its odometry there."""
        self._base.place(pose)
        self._odometer.reset(pose, self._base.wheel_angles_rad)

    def act(self, action: Action) -> ActionResult:
        """Execute an action at once; the simulated time advances by the duration on a real robot."""
        if action == Action.STOP:
            return ActionResult(action, collided=False, wheel_speeds=STILL, moved_m=0.0)
        # The profile scales the twist over time and keeps its direction. The wheel speeds keep their ratio, so one
        # exponential of the whole motion is exact.
        forward_m, turn_rad = action_motion(action)
        profile = self.profile(action)
        duration_s = profile.duration_s
        if not self._roll(forward_m, turn_rad, duration_s, profile):
            return ActionResult(action, True, STILL, 0.0, met_person=self._met_person)
        speeds = self._kinematics.wheel_speeds(forward_m / duration_s, turn_rad / duration_s)
        return ActionResult(action, collided=False, wheel_speeds=speeds, moved_m=abs(forward_m))

    def profile(self, action: Action) -> Trapezoid:
        """How far an action has come when."""
        return action_profile(action, self._limits)

    def anticipate(self, actions: Sequence[Action], data: mujoco.MjData) -> Pose2:
        """Write positions and time after some actions into other data of the same model, as if nothing were in the way.
        Returns the pose of the base then.
        """
        base = next((base for known, base in self._ahead if known is data), None)
        if base is None:
            base = simulated_base(self._model, data, self._prefix, self._description)
            self._ahead.append((data, base))
        data.qpos[:], data.time = self._data.qpos, self._data.time
        for action in actions:
            self._move(base, *action_motion(action))
            data.time += action_profile(action, self._limits).duration_s
        return base.pose

    def drive(self, twist: Twist, duration_s: float) -> MotionResult:
        """Roll at a constant velocity for a time [s], all of it or nothing. Raises RobotError if the duration is not
        positive, or the velocity not finite.
        """
        require_motion(twist, duration_s)
        forward_m, turn_rad = twist.forward_mps * duration_s, twist.turn_radps * duration_s
        if not self._roll(forward_m, turn_rad, duration_s):
            return MotionResult(True, STILL, 0.0, 0.0, duration_s)
        speeds = self._kinematics.wheel_speeds(twist.forward_mps, twist.turn_radps)
        return MotionResult(False, speeds, abs(forward_m), abs(turn_rad), duration_s)

    def look_at(self, point_m: Float[np.ndarray, "3"]) -> MotionResult:
        """Turn on the spot until the camera's axis and a point of the world share a vertical plane. Raises RobotError
        where no turn brings this about, as :meth:`LookAt.turn_rad`.
        """
        controller, turned_rad = self._look_at_controller(), 0.0
        start_s, start_angles_rad = self._data.time, self._base.wheel_angles_rad
        while (following := controller.next_pose(pose := self._base.pose, point_m)) is not None:
            turn_rad = math.remainder(following.yaw_rad - pose.yaw_rad, math.tau)
            self._roll(0.0, turn_rad, self._period_s)
            turned_rad += abs(turn_rad)
        speeds = self._mean_speeds(start_s, start_angles_rad)
        return MotionResult(False, speeds, 0.0, turned_rad, self._data.time - start_s)

    def _roll(self, forward_m: float, turn_rad: float, duration_s: float, profile: Trapezoid | None = None) -> bool:
        """Roll at a constant ratio of the wheel speeds; False, with the robot unmoved, if something is in the way.
        ``profile`` tells how far it has come when; None = at a constant velocity.
        """
        self._note()
        self._data.time += duration_s
        self._met_person = False
        free = not forward_m or not self._is_in_the_way(forward_m, turn_rad)
        if free:
            self._move(self._base, forward_m, turn_rad)
            self._odometer.update(self._base.wheel_angles_rad)
        self._pass_time()
        self._note(profile)
        return free

    def _is_in_the_way(self, forward_m: float, turn_rad: float) -> bool:
        """Whether a motion from the present pose meets an obstacle or a person."""
        pose = self._base.pose
        if self._crowd is not None:
            # Chords of an arc; the straight line of a motion without a turn.
            pieces = max(1, math.ceil(abs(turn_rad) / _CHORD_RAD))
            shares = (np.arange(pieces + 1) / pieces).tolist()
            places_m = [move_pose(pose, share * forward_m, share * turn_rad).xy_m for share in shares]
            self._met_person = any(self._crowd.touches(*line) for line in pairwise(places_m))
            radius_m = self._description.footprint.radius_m
            if any(self._crowd.doors.touches(*line, radius_m) for line in pairwise(places_m)):
                return True
        return self._met_person or self._clearance.sweep_collides(pose, forward_m, turn_rad)

    def _move(self, base: SimulatedBase | PlanarBase, forward_m: float, turn_rad: float) -> None:
        pose = base.pose
        left_rad, right_rad = self._kinematics.wheel_motion(forward_m, turn_rad)
        base.turn_wheels(left_rad, right_rad)
        if isinstance(self._kinematics, PlanarKinematics):
            assert isinstance(base, PlanarBase)
            base.move_to(move_pose(pose, forward_m, turn_rad))
        else:
            base.place(self._kinematics.odometry(pose, left_rad, right_rad))
