"""Mounts the camera that the settings ask for in place of the one in the robot's file."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.frames import T_GL_CV, rigid_transform
from anm_mj.robot.camera_config import CameraConfig

_ROLL_DEG = 10.0
"""A camera rolled by less counts as upright [deg]."""
_LEVEL = 0.1


def remount_camera(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    name: str,
    T_world_base: Float[np.ndarray, "4 4"],
    config: CameraConfig,
    image_px: int,
) -> Float[np.ndarray, "4 4"]:
    """Change height, tilt and field of view of a camera in the spec.

    Args:
        spec: the robot; its camera is changed in place.
        model: compiled from it.
        data: of the model, with up-to-date poses.
        name: of the camera.
        T_world_base: base frame to world.
        config: what is asked for.
        image_px: width and height of the image where the configuration does not say [px].

    Returns:
        Camera to base; camera axes x right, y down, z forward.
    """
    camera = model.camera(name).id
    T_world_camera = rigid_transform(data.cam_xmat[camera], data.cam_xpos[camera]) @ T_GL_CV
    T_base_camera = np.linalg.inv(T_world_base) @ T_world_camera
    if config.fov_deg:
        _of(spec, name).fovy = config.fov_y_deg(image_px)
    if not (config.height_m or config.tilt_deg):
        return T_base_camera
    if config.height_m:
        T_base_camera[2, 3] = config.height_m
    c, s = math.cos(math.radians(config.tilt_deg)), math.sin(math.radians(config.tilt_deg))
    # About the camera's x axis, which points right: a positive angle lifts the view.
    T_base_camera[:3, :3] = T_base_camera[:3, :3] @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    _place(spec, model, data, name, T_world_base, T_base_camera)
    return T_base_camera


def upright_camera(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    name: str,
    T_world_base: Float[np.ndarray, "4 4"],
) -> str:
    """Turn a camera that is mounted on its side or upside down about its axis until its image is upright.

    Its image is square unless the settings say otherwise, so that it shows the same.

    Args:
        spec: the robot; its camera is changed in place.
        model: compiled from it.
        data: of the model, with up-to-date poses.
        name: of the camera.
        T_world_base: base frame to world.

    Returns:
        What was done, for the notes; empty where the camera stands upright.
    """
    camera = model.camera(name).id
    T_world_camera = rigid_transform(data.cam_xmat[camera], data.cam_xpos[camera]) @ T_GL_CV
    T_base_camera = np.linalg.inv(T_world_base) @ T_world_camera
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
    _place(spec, model, data, name, T_world_base, T_base_camera)
    return f"camera {name} is mounted rolled by {roll_deg:.0f} degrees; its image is turned upright"


def _place(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    name: str,
    T_world_base: Float[np.ndarray, "4 4"],
    T_base_camera: Float[np.ndarray, "4 4"],
) -> None:
    """Move a camera of the spec to a pose in the base frame."""
    body = model.cam_bodyid[model.camera(name).id]
    T_world_body = rigid_transform(data.xmat[body], data.xpos[body])
    T_body_camera = np.linalg.inv(T_world_body) @ T_world_base @ T_base_camera @ T_GL_CV
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, T_body_camera[:3, :3].ravel())
    element = _of(spec, name)
    element.pos, element.quat = T_body_camera[:3, 3], quat
    element.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT


def _of(spec: mujoco.MjSpec, name: str) -> mujoco._specs.MjsCamera:
    return next(camera for camera in spec.cameras if camera.name == name)
