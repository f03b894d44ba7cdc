"""Planar access to a base in a MuJoCo simulation: its free joint and its wheel hinges, or its planar joints."""

import math

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.errors import RobotError
from anm_mj.frames import wrap_angle
from anm_mj.mjcf.poses import quaternion_of
from anm_mj.robot.description import RobotDescription
from anm_mj.robot.drive_joints import HOLONOMIC
from anm_mj.robot.reduced_model import BASE_JOINT, WHEEL_JOINTS
from anm_mj.types import Pose2

_JOINT = mujoco.mjtObj.mjOBJ_JOINT


class SimulatedBase:
    """Reads and writes the base's joints in ``data.qpos``."""

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, prefix: str = "", robot: RobotDescription | None = None
    ):
        """Look the joints of a robot, alone or in a scene, up by name; ``prefix`` precedes its names there.

        Without ``robot`` it is a reduced model (:mod:`anm_mj.robot.reduced_model`), whose root body is the base. Raises
        RobotError if a joint is missing, or the base has no free joint.
        """
        base_joint, wheel_joints = (robot.base_joints[0], robot.wheel_joints) if robot else (BASE_JOINT, WHEEL_JOINTS)
        self._data = data
        base = element_id(model, _JOINT, prefix + base_joint)
        if model.jnt_type[base] != mujoco.mjtJoint.mjJNT_FREE:
            raise RobotError(f'The joint "{prefix}{base_joint}" of the simulated robot must be a <freejoint>.')
        self._base_qpos = int(model.jnt_qposadr[base])
        self._base_qvel = int(model.jnt_dofadr[base])
        wheels = [element_id(model, _JOINT, prefix + name) for name in wheel_joints]
        self._wheel_qpos = np.array([model.jnt_qposadr[wheel] for wheel in wheels])
        self._signs = np.array(robot.wheel_signs if robot else (1.0, 1.0))
        self._T_root_base = robot.T_root_base if robot else np.eye(4)
        T_base_root = np.linalg.inv(self._T_root_base)
        self._root_xyz_m = T_base_root[:3, 3]
        self._root_quat = quaternion_of(T_base_root[:3, :3])
        self._offset, self._ahead, self._quat = np.empty(3), np.empty(3), np.empty(4)
        self._place, self._forward = (self._T_root_base[:3, column].copy() for column in (3, 0))
        """Of the base in its root body."""

    @property
    def pose(self) -> Pose2:
        """Pose of the base in the plane, without its tilt."""
        q = self._data.qpos[self._base_qpos : self._base_qpos + 7]
        mujoco.mju_rotVecQuat(self._offset, self._place, q[3:])
        mujoco.mju_rotVecQuat(self._ahead, self._forward, q[3:])
        # Plain numbers: NumPy takes several times as long for each.
        (x, y), (off_x, off_y, _) = q[:2].tolist(), self._offset.tolist()
        ahead_x, ahead_y, _ = self._ahead.tolist()
        return Pose2(x + off_x, y + off_y, wrap_angle(math.atan2(ahead_y, ahead_x)))

    def place(self, pose: Pose2) -> None:
        """Put the base upright on the floor at a pose."""
        c, s = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
        x, y, z = self._root_xyz_m.tolist()
        half = pose.yaw_rad / 2.0
        mujoco.mju_mulQuat(self._quat, np.array([math.cos(half), 0.0, 0.0, math.sin(half)]), self._root_quat)
        start = self._base_qpos
        self._data.qpos[start : start + 3] = (pose.x_m + c * x - s * y, pose.y_m + s * x + c * y, z)
        self._data.qpos[start + 3 : start + 7] = self._quat

    @property
    def speed_mps(self) -> float:
        """Speed of the base over the floor [m/s]."""
        v = self._data.qvel[self._base_qvel : self._base_qvel + 6]
        # A free joint has its angular velocity in body axes and its linear velocity in world axes.
        moved = np.cross(v[3:], self._T_root_base[:3, 3])
        mujoco.mju_rotVecQuat(self._offset, moved, self._data.qpos[self._base_qpos + 3 : self._base_qpos + 7])
        return math.hypot(v[0] + self._offset[0], v[1] + self._offset[1])

    @property
    def turn_rate_radps(self) -> float:
        """Turn rate of the base, counter-clockwise [rad/s]."""
        omega = self._data.qvel[self._base_qvel + 3 : self._base_qvel + 6]
        return float(omega @ self._T_root_base[:3, 2])

    @property
    def wheel_angles_rad(self) -> Float[np.ndarray, "2"]:
        """Rotation of the left and the right wheels, the mean of each side, positive when rolling forward."""
        angles = self._signs * self._data.qpos[self._wheel_qpos]
        return angles if len(angles) == 2 else angles.reshape(2, -1).mean(axis=1)

    def turn_wheels(self, left_rad: float, right_rad: float) -> None:
        """Add to the wheels' angles, positive when rolling forward."""
        self._data.qpos[self._wheel_qpos] += self._signs * np.repeat((left_rad, right_rad), len(self._signs) // 2)

    @property
    def tilt_rad(self) -> float:
        """Angle between the base's z axis and the vertical."""
        q = self._data.qpos[self._base_qpos + 3 : self._base_qpos + 7]
        mujoco.mju_rotVecQuat(self._offset, self._T_root_base[:3, 2], q)
        return math.acos(max(-1.0, min(1.0, float(self._offset[2]))))


class PlanarBase:
    """The same access to a holonomic base: the positions of its three joints are its pose."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, prefix: str, joints: tuple[str, ...]):
        """As :class:`SimulatedBase`, of two slides along the world's x and y, and a hinge about the base's z. Raises
        RobotError if a joint is missing.
        """
        ids = [element_id(model, _JOINT, prefix + name) for name in joints]
        self._data = data
        self._qpos = np.array([model.jnt_qposadr[joint] for joint in ids])
        self._qvel = np.array([model.jnt_dofadr[joint] for joint in ids])

    @property
    def pose(self) -> Pose2:
        """Pose of the base in the plane."""
        x, y, yaw = self._data.qpos[self._qpos].tolist()
        return Pose2(x, y, wrap_angle(yaw))

    def place(self, pose: Pose2) -> None:
        """Put the base at a pose."""
        self._data.qpos[self._qpos] = (pose.x_m, pose.y_m, pose.yaw_rad)

    def move_to(self, pose: Pose2) -> None:
        """Put the base at a pose that it reaches by turning the shortest way: what it moved by is a difference of
        positions.
        """
        turns = round((self._data.qpos[self._qpos[2]] - pose.yaw_rad) / math.tau)
        self._data.qpos[self._qpos] = (pose.x_m, pose.y_m, pose.yaw_rad + math.tau * turns)

    @property
    def speed_mps(self) -> float:
        """Speed of the base over the floor [m/s]."""
        return math.hypot(*self._data.qvel[self._qvel[:2]].tolist())

    @property
    def turn_rate_radps(self) -> float:
        """Turn rate of the base, counter-clockwise [rad/s]."""
        return float(self._data.qvel[self._qvel[2]])

    @property
    def wheel_angles_rad(self) -> Float[np.ndarray, "3"]:
        """What its encoders read, in place of wheels: x [m], y [m], yaw [rad]."""
        return self._data.qpos[self._qpos].copy()

    def turn_wheels(self, left_rad: float, right_rad: float) -> None:
        """It has no wheels."""

    @property
    def tilt_rad(self) -> float:
        """Planar joints keep it upright."""
        return 0.0


def simulated_base(
    model: mujoco.MjModel, data: mujoco.MjData, prefix: str, robot: RobotDescription
) -> SimulatedBase | PlanarBase:
    """Access to the base of a robot, by what moves it. Raises RobotError if a joint is missing."""
    if robot.kind == HOLONOMIC:
        return PlanarBase(model, data, prefix, robot.base_joints)
    return SimulatedBase(model, data, prefix, robot)


def element_id(model: mujoco.MjModel, kind: mujoco.mjtObj, name: str) -> int:
    """Index of a named element of the simulated robot. Raises RobotError if there is none."""
    found = mujoco.mj_name2id(model, kind, name)
    if found < 0:
        what = kind.name.removeprefix("mjOBJ_").lower()
        raise RobotError(
            f'The simulated robot has no {what} "{name}"; see models/diff_drive/diff_drive.xml for one that has.'
        )
    return found
