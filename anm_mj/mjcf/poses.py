"""Poses of bodies and cameras: read from a compiled robot, and given to elements of its spec."""

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.frames import T_GL_CV, rigid_transform


def body_pose(data: mujoco.MjData, body: int) -> Float[np.ndarray, "4 4"]:
    """Body to world."""
    return rigid_transform(data.xmat[body], data.xpos[body])


def camera_pose(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> Float[np.ndarray, "4 4"]:
    """Camera to world; camera axes x right, y down, z forward."""
    camera = model.camera(name).id
    return rigid_transform(data.cam_xmat[camera], data.cam_xpos[camera]) @ T_GL_CV


def quaternion_of(rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "4"]:
    """The rotation as w, x, y, z."""
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).ravel())
    return quaternion


def set_pose(
    element: "mujoco._specs.MjsBody | mujoco._specs.MjsCamera", T_parent_element: Float[np.ndarray, "4 4"]
) -> None:
    """Put a body or a camera of a spec at a pose in its parent body, in MuJoCo's axes."""
    if element.frame is not None:
        # What stands in a frame of the file has its pose in that frame; one that moves nothing takes its place.
        element.set_frame(element.parent.add_frame())
    element.pos, element.quat = T_parent_element[:3, 3], quaternion_of(T_parent_element[:3, :3])
    element.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
