"""Kinematics of a differential-drive robot, read by pinocchio from the robot's reduced model.

pinocchio's MJCF reader silently ignores elements that it does not know (``<frame>``, masses in defaults, all but the
first body of the world), so its figures are compared with MuJoCo's.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from anm_mj.errors import RobotError
from anm_mj.frames import move_pose, pose_matrix
from anm_mj.robot.description import RobotDescription
from anm_mj.robot.drive_joints import HOLONOMIC
from anm_mj.robot.reduced_model import CAMERA, WHEEL_JOINTS
from anm_mj.types import Pose2, WheelSpeeds

SAME_ROBOT = 1e-9
"""Largest difference between pinocchio's and MuJoCo's figures of a robot [m, kg]."""


class _Kinematics:
    """What the kinematics of all bases have: a camera that is mounted rigidly."""

    T_base_camera: Float[np.ndarray, "4 4"]
    """Camera to base; camera axes x right, y down, z forward."""

    def T_world_camera(self, pose: Pose2) -> Float[np.ndarray, "4 4"]:
        """Camera to world, for a base on the floor."""
        return pose_matrix(pose) @ self.T_base_camera

    def wheel_motion(self, forward: float, turn: float) -> tuple[float, float]:
        """Left and right wheel motion from forward motion and turn; no wheel turns where there is none."""
        return 0.0, 0.0

    def wheel_speeds(self, forward_mps: float, turn_radps: float) -> WheelSpeeds:
        """Wheel speeds for a forward speed and a turn rate."""
        return WheelSpeeds(*self.wheel_motion(forward_mps, turn_radps))


class RobotKinematics(_Kinematics):
    """Camera pose, and the relation between wheel and body motion, of a differential-drive base."""

    def __init__(self, robot: RobotDescription):
        """Read the reduced model of a robot. Raises RobotError if pinocchio cannot, or figures differ from MuJoCo's."""
        with tempfile.TemporaryDirectory() as folder:
            # pinocchio reads MJCF from files only.
            path = Path(folder) / f"{robot.name}.xml"
            path.write_text(robot.reduced_mjcf, encoding="utf-8")
            try:
                model = pin.buildModelFromMJCF(str(path))
            except (ValueError, RuntimeError) as err:
                raise RobotError(f"pinocchio cannot read the robot {robot.name}: {err}") from err
        data = model.createData()
        left, right = (model.jointPlacements[model.getJointId(name)].translation for name in WHEEL_JOINTS)
        self.wheel_radius_m = float(left[2])
        """Rolling radius of the wheels: the height of their axle above the floor [m]."""
        track_m = float(left[1] - right[1])
        self.track_m = track_m * robot.track_scale
        """Effective track: the distance between the planes of the wheels [m], times the robot's ``track_scale``."""
        pin.framesForwardKinematics(model, data, pin.neutral(model))
        self.T_base_camera = data.oMf[model.getFrameId(CAMERA, pin.FrameType.OP_FRAME)].homogeneous.copy()
        ours = np.array([pin.computeTotalMass(model), self.wheel_radius_m, track_m, *self.T_base_camera.ravel()])
        theirs = np.array([robot.mass_kg, robot.wheel_radius_m, robot.track_m, *robot.T_base_camera.ravel()])
        if np.abs(ours - theirs).max() > SAME_ROBOT:
            raise RobotError(
                f"pinocchio reads the robot {robot.name} differently from MuJoCo: mass, wheel radius and track are "
                f"{ours[:3]} instead of {theirs[:3]}; the installed versions of the two do not go together."
            )

    @property
    def wheel_jacobian(self) -> Float[np.ndarray, "2 2"]:
        """Forward speed and turn rate (rows) per left and right wheel speed (columns), rolling without slip. Source:
        Lynch and Park, Modern Robotics, 2017, section 13.3.1 (differential drive).
        """
        r, track = self.wheel_radius_m, self.track_m
        return np.array([[r / 2.0, r / 2.0], [-r / track, r / track]])

    def body_motion(self, left: float, right: float) -> tuple[float, float]:
        """Forward motion and turn from wheel motions: m and rad from rad, or m/s and rad/s from rad/s."""
        forward = self.wheel_radius_m * (right + left) / 2.0
        turn = self.wheel_radius_m * (right - left) / self.track_m
        return forward, turn

    def wheel_motion(self, forward: float, turn: float) -> tuple[float, float]:
        """Left and right wheel motion from forward motion and turn: the inverse of :meth:`body_motion`."""
        radius, half_track = self.wheel_radius_m, self.track_m / 2.0
        return (forward - turn * half_track) / radius, (forward + turn * half_track) / radius

    def odometry(self, pose: Pose2, left_rad: float, right_rad: float) -> Pose2:
        """The pose after these wheel rotations at a constant speed ratio: the SE(2) exponential. Source: Lynch and
        Park, Modern Robotics, 2017, section 13.4 (odometry).
        """
        return move_pose(pose, *self.body_motion(left_rad, right_rad))


class PlanarKinematics(_Kinematics):
    """Camera pose of a holonomic base, whose joints are its position and heading; it has no wheels."""

    def __init__(self, T_base_camera: Float[np.ndarray, "4 4"]):
        """``T_base_camera``: camera to base; camera axes x right, y down, z forward."""
        self.T_base_camera = T_base_camera


Kinematics = RobotKinematics | PlanarKinematics


def kinematics_of(robot: RobotDescription) -> Kinematics:
    """The kinematics of a robot, by what moves it. Raises RobotError if the figures of pinocchio and MuJoCo differ."""
    return PlanarKinematics(robot.T_base_camera) if robot.kind == HOLONOMIC else RobotKinematics(robot)
