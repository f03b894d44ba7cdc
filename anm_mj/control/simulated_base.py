"""The joints of a differential-drive base in a MuJoCo simulation: the free joint, seen in the plane, and the wheels."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.control.robot_model import BASE_JOINT, WHEEL_JOINTS
from anm_mj.errors import RobotError
from anm_mj.types import Pose2


class SimulatedBase:
    """Reads and writes the base's joints in ``data.qpos``."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, prefix: str = ""):
        """Look the joints up by name.

        Args:
            model: the robot, alone or in a scene.
            data: of that model.
            prefix: what the robot's names got before them when it was attached to the scene.

        Raises:
            RobotError: if one is missing, or the base's is not a free joint.
        """
        self._data = data
        base = _joint_id(model, prefix + BASE_JOINT)
        if model.jnt_type[base] != mujoco.mjtJoint.mjJNT_FREE:
            raise RobotError(f'The joint "{prefix}{BASE_JOINT}" of the simulated robot must be a <freejoint>.')
        self._base_qpos = int(model.jnt_qposadr[base])
        self._base_qvel = int(model.jnt_dofadr[base])
        self._wheel_qpos = np.array([model.jnt_qposadr[_joint_id(model, prefix + name)] for name in WHEEL_JOINTS])

    @property
    def pose(self) -> Pose2:
        """Where the base stands in the plane; a tilt is left out."""
        q = self._data.qpos[self._base_qpos : self._base_qpos + 7]
        x, y, _, qw, qx, qy, qz = q.tolist()
        return Pose2(x, y, math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy**2 + qz**2)))

    def place(self, pose: Pose2) -> None:
        """Stand the base upright on the floor at a pose."""
        half = pose.yaw_rad / 2.0
        start = self._base_qpos
        self._data.qpos[start : start + 7] = (pose.x_m, pose.y_m, 0.0, math.cos(half), 0.0, 0.0, math.sin(half))

    @property
    def speed_mps(self) -> float:
        """Speed of the base over the floor."""
        vx, vy = self._data.qvel[self._base_qvel : self._base_qvel + 2]
        return math.hypot(vx, vy)

    @property
    def turn_rate_radps(self) -> float:
        """Turn rate of the base, counter-clockwise."""
        return float(self._data.qvel[self._base_qvel + 5])

    @property
    def wheel_angles_rad(self) -> Float[np.ndarray, "2"]:
        """How far the left and the right wheel have turned."""
        return self._data.qpos[self._wheel_qpos]

    def turn_wheels(self, left_rad: float, right_rad: float) -> None:
        """Add to the wheels' angles."""
        self._data.qpos[self._wheel_qpos] += (left_rad, right_rad)


def _joint_id(model: mujoco.MjModel, name: str) -> int:
    """Raises RobotError if there is no such joint."""
    joint_id = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
    if joint_id < 0:
        raise RobotError(
            f'The simulated robot has no joint "{name}"; see models/diff_drive/diff_drive.xml for one that has.'
        )
    return joint_id
