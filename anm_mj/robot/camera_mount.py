"""Mounts a robot's camera: as the settings ask for, upright, or where its file has none."""

import math

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.frames import T_GL_CV
from anm_mj.mjcf.poses import body_pose, camera_pose, quaternion_of, set_pose
from anm_mj.robot.body_tree import CompiledRobot, unused_name
from anm_mj.robot.camera_config import CameraConfig
from anm_mj.robot.camera_search import CAMERA
from anm_mj.robot.robot_config import CameraPose

_ROLL_DEG = 10.0
"""A camera rolled by less counts as upright [deg]."""
_LEVEL = 0.1


def mount_camera(spec: mujoco.MjSpec, root: str, T_root_base: Float[np.ndarray, "4 4"], pose: CameraPose) -> str:
    """Add a camera to the robot's root body; its name."""
    pitch = math.radians(pose.pitch_deg)
    T_base_camera = np.eye(4)
    T_base_camera[:3, 0] = [0.0, -1.0, 0.0]
    T_base_camera[:3, 2] = [math.cos(pitch), 0.0, -math.sin(pitch)]
    T_base_camera[:3, 1] = np.cross(T_base_camera[:3, 2], T_base_camera[:3, 0])
    T_base_camera[:3, 3] = pose[:3]
    T_root_camera = T_root_base @ T_base_camera @ T_GL_CV
    quat = quaternion_of(T_root_camera[:3, :3])
    name = unused_name(CAMERA, spec.camera)
    spec.body(root).add_camera(name=name, pos=T_root_camera[:3, 3], quat=quat, fovy=pose.fovy_deg)
    return name


def remount_camera(
    robot: CompiledRobot, name: str, T_world_base: Float[np.ndarray, "4 4"], config: CameraConfig, image_px: int
) -> None:
    """Change height, tilt and field of view of the camera ``name`` in the spec, as the configuration asks for.

    ``image_px`` is the size of an image where the configuration does not say [px].
    """
    if config.fov_deg:
        robot.spec.camera(name).fovy = config.fov_y_deg(image_px)
    if not (config.height_m or config.tilt_deg):
        return
    T_base_camera = np.linalg.inv(T_world_base) @ camera_pose(robot.model, robot.data, name)
    if config.height_m:
        T_base_camera[2, 3] = config.height_m
    c, s = math.cos(math.radians(config.tilt_deg)), math.sin(math.radians(config.tilt_deg))
    # About the camera's x axis, which points right: a positive angle lifts the view.
    T_base_camera[:3, :3] = T_base_camera[:3, :3] @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    _place(robot, name, T_world_base, T_base_camera)


def upright_camera(robot: CompiledRobot, name: str, T_world_base: Float[np.ndarray, "4 4"]) -> str:
    """Turn a camera that is mounted on its side or upside down about its axis until its image is upright.

    Its image is square unless the settings say otherwise, so that it shows the same. Arguments as for
    :func:`remount_camera`. Returns what was done, for the notes; empty where the camera stands upright.
    """
    T_base_camera = np.linalg.inv(T_world_base) @ camera_pose(robot.model, robot.data, name)
    ahead = T_base_camera[:3, 2]
    level = np.array([ahead[1], -ahead[0], 0.0])
    if np.linalg.norm(level) < _LEVEL:
        return ""  # Straight up or down: nothing is upright.
    level /= np.linalg.norm(level)
    down = np.cross(ahead, level)
    roll_deg = math.degrees(math.atan2(float(T_base_camera[:3, 0] @ down), float(T_base_camera[:3, 0] @ level)))
    if abs(roll_deg) < _ROLL_DEG:
        return ""
    T_base_camera[:3, 0], T_base_camera[:3, 1] = level, down
    _place(robot, name, T_world_base, T_base_camera)
    return f"camera {name} is mounted rolled by {roll_deg:.0f} degrees; its image is turned upright"


def _place(
    robot: CompiledRobot, name: str, T_world_base: Float[np.ndarray, "4 4"], T_base_camera: Float[np.ndarray, "4 4"]
) -> None:
    T_world_body = body_pose(robot.data, int(robot.model.camera(name).bodyid[0]))
    set_pose(robot.spec.camera(name), np.linalg.inv(T_world_body) @ T_world_base @ T_base_camera @ T_GL_CV)
