"""Kinematics of a differential-drive robot, read by pinocchio from the MJCF that the simulator reads.

A real robot could run this module: it knows nothing of a simulator. pinocchio's MJCF reader silently ignores elements
that it does not know (``<frame>``, masses in defaults, all but the first body of the world), so the constructor
requires every part by name.
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
from anm_mj.robot.reduced_model import BASE_JOINT, CAMERA, WHEEL_JOINTS
from anm_mj.types import Pose2, WheelSpeeds

SAME_ROBOT = 1e-9
"""Largest difference between pinocchio's and MuJoCo's figures of a robot [m, kg]."""


class _Kinematics:
    """What the kinematics of all bases have: a camera that is mounted rigidly."""

    _T_base_camera: Float[np.ndarray, "4 4"]

    @property
    def T_base_camera(self) -> Float[np.ndarray, "4 4"]:
        """Camera to base; camera axes x right, y down, z forward."""
        return self._T_base_camera.copy()

    def T_world_camera(self, pose: Pose2) -> Float[np.ndarray, "4 4"]:
        """Camera to world, for a base on the floor."""
        return pose_matrix(pose) @ self._T_base_camera

    def wheel_motion(self, forward: float, turn: float) -> tuple[float, float]:
        """Left and right wheel motion from forward motion and turn; no wheel turns where there is none."""
        del forward, turn
        return 0.0, 0.0

    def wheel_speeds(self, forward_mps: float, turn_radps: float) -> WheelSpeeds:
        """Wheel speeds for a forward speed and a turn rate."""
        return WheelSpeeds(*self.wheel_motion(forward_mps, turn_radps))


class RobotKinematics(_Kinematics):
    """Camera pose, and the relation between wheel and body motion, of a differential-drive base."""

    def __init__(self, mjcf_path: Path):
        """Read the model. ``mjcf_path`` is a robot or a reduced model, with a free joint "base", hinges "wheel_left"
        and "wheel_right", and a site "camera". Raises RobotError if the file cannot be read, or is not such a robot.
        """
        try:
            self._model = pin.buildModelFromMJCF(str(mjcf_path))
        except (ValueError, RuntimeError) as err:
            raise RobotError(f"pinocchio cannot read the robot {mjcf_path}: {err}") from err
        self._data = self._model.createData()
        _require_parts(self._model, mjcf_path)
        self._camera_frame = self._model.getFrameId(CAMERA, pin.FrameType.OP_FRAME)

        left, right = (self._model.jointPlacements[self._model.getJointId(name)] for name in WHEEL_JOINTS)
        _require_differential_drive(left, right, mjcf_path)
        self._wheel_radius_m = float(left.translation[2])
        self._track_m = float(left.translation[1] - right.translation[1])
        pin.framesForwardKinematics(self._model, self._data, pin.neutral(self._model))
        self._T_base_camera = self._data.oMf[self._camera_frame].homogeneous.copy()

    @classmethod
    def of(cls, robot: RobotDescription) -> RobotKinematics:
        """The kinematics of any robot, from its reduced model. Raises RobotError if the figures of pinocchio and MuJoCo
        differ.
        """
        with tempfile.TemporaryDirectory() as folder:
            # pinocchio reads MJCF from files only.
            path = Path(folder) / f"{robot.name}.xml"
            path.write_text(robot.reduced_mjcf, encoding="utf-8")
            model = cls(path)
        ours = np.array([model.mass_kg, model.wheel_radius_m, model.track_m, *model.T_base_camera.ravel()])
        theirs = np.array([robot.mass_kg, robot.wheel_radius_m, robot.track_m, *robot.T_base_camera.ravel()])
        if np.abs(ours - theirs).max() > SAME_ROBOT:
            raise RobotError(
                f"pinocchio reads the robot {robot.name} differently from MuJoCo: mass, wheel radius and track are "
                f"{ours[:3]} instead of {theirs[:3]}; the installed versions of the two do not go together."
            )
        model._track_m *= robot.track_scale
        return model

    @property
    def wheel_radius_m(self) -> float:
        """Rolling radius of the wheels: the height of their axle above the floor [m]."""
        return self._wheel_radius_m

    @property
    def track_m(self) -> float:
        """Effective track: the distance between the planes of the wheels [m], times the robot's ``track_scale``."""
        return self._track_m

    @property
    def mass_kg(self) -> float:
        """Mass of the whole robot [kg]."""
        return float(pin.computeTotalMass(self._model))

    @property
    def wheel_jacobian(self) -> Float[np.ndarray, "2 2"]:
        """Forward speed and turn rate (rows) per left and right wheel speed (columns), rolling without slip.

        Source: Lynch and Park, Modern Robotics, 2017, section 13.3.1 (differential drive).
        """
        r, track = self._wheel_radius_m, self._track_m
        return np.array([[r / 2.0, r / 2.0], [-r / track, r / track]])

    def body_motion(self, left: float, right: float) -> tuple[float, float]:
        """Forward motion and turn from wheel motions: m and rad from rad, or m/s and rad/s from rad/s."""
        forward = self._wheel_radius_m * (right + left) / 2.0
        turn = self._wheel_radius_m * (right - left) / self._track_m
        return forward, turn

    def wheel_motion(self, forward: float, turn: float) -> tuple[float, float]:
        """Left and right wheel motion from forward motion and turn: the inverse of :meth:`body_motion`."""
        radius, half_track = self._wheel_radius_m, self._track_m / 2.0
        return (forward - turn * half_track) / radius, (forward + turn * half_track) / radius

    def odometry(self, pose: Pose2, left_rad: float, right_rad: float) -> Pose2:
        """The pose after these wheel rotations at a constant speed ratio: the SE(2) exponential.

        Source: Lynch and Park, Modern Robotics, 2017, section 13.4 (odometry).
        """
        return move_pose(pose, *self.body_motion(left_rad, right_rad))


class PlanarKinematics(_Kinematics):
    """Camera pose of a holonomic base, whose joints are its position and heading; it has no wheels."""

    def __init__(self, T_base_camera: Float[np.ndarray, "4 4"]):
        """``T_base_camera``: camera to base; camera axes x right, y down, z forward."""
        self._T_base_camera = T_base_camera


Kinematics = RobotKinematics | PlanarKinematics


def kinematics_of(robot: RobotDescription) -> Kinematics:
    """The kinematics of a robot, by what moves it. Raises RobotError if the figures of pinocchio and MuJoCo differ."""
    return PlanarKinematics(robot.T_base_camera) if robot.kind == HOLONOMIC else RobotKinematics.of(robot)


def _require_parts(model: pin.Model, path: Path) -> None:
    missing = [name for name in (BASE_JOINT, *WHEEL_JOINTS) if not model.existJointName(name)]
    if missing:
        raise RobotError(
            f"The robot {path} has no joint {', '.join(missing)} (pinocchio found {list(model.names)[1:]}); a free "
            'joint "base" and hinges "wheel_left" and "wheel_right" are needed, in the first body of the world and not '
            "in a <frame>."
        )
    if not model.existFrame(CAMERA, pin.FrameType.OP_FRAME):
        raise RobotError(f'The robot {path} has no site "{CAMERA}" at its camera; add one (z forward, y down).')


def _require_differential_drive(left: pin.SE3, right: pin.SE3, path: Path) -> None:
    (xl, yl, zl), (xr, yr, zr) = left.translation, right.translation
    if not (np.allclose([xl, xr, yl + yr, zl - zr], 0.0, atol=1e-9) and yl > 0.0 and zl > 0.0):
        raise RobotError(
            f"The robot {path} has wheels at {left.translation} and {right.translation} in its base; they must lie at "
            "(0, y, r) and (0, -y, r): one axle through the base's origin, left wheel at positive y."
        )
