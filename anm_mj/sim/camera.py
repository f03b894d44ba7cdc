"""Base class of the RGB-D cameras, which render a simulated world by GL or by ray casting."""

import math
from abc import ABC, abstractmethod
from typing import TypeVar

import mujoco
import numpy as np
from jaxtyping import Float, Float32, UInt8

from anm_mj.errors import RenderError
from anm_mj.frames import T_GL_CV, rigid_transform
from anm_mj.types import Intrinsics

VISIBLE_GROUPS = (0, 2)
"""Geom groups that the camera sees: 0, the default group of MJCF, and 2, the visual meshes of a scene. It does not see
the robot's own body (1) and the scene's collision boxes (3)."""

Image = tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]
"""Colours, and planar depth [m]."""
_Self = TypeVar("_Self", bound="Camera")
"""typing.Self, which beartype does not support in methods that jaxtyping checks."""


class Camera(ABC):
    """An RGB-D pinhole camera of a model; close it, or use it in a ``with`` statement."""

    kind: str
    """Rendering method: ``gl``, ``embree`` or ``mujoco rays``."""

    def __init__(self, model: mujoco.MjModel, camera_name: str, width: int, height: int):
        """Look up a perspective camera, given by a vertical field of view (``fovy``); the image's size is in pixels.
        Raises RenderError if there is no such camera, or a sensor size defines it.
        """
        self._model = model
        self._camera_id = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, camera_name)
        if self._camera_id < 0:
            known = [model.camera(i).name for i in range(model.ncam)]
            raise RenderError(
                f'The model has no camera "{camera_name}"; it has {known}. Name one of these, or add it to the MJCF.'
            )
        if model.cam_sensorsize[self._camera_id].any():
            raise RenderError(
                f'Camera "{camera_name}" is given by a sensor size; give it by its field of view (fovy) instead.'
            )
        self.intrinsics = Intrinsics.from_fov(width, height, math.radians(model.cam_fovy[self._camera_id]))
        """The exact pinhole model of the images."""

    def T_world_camera(self, data: mujoco.MjData) -> Float[np.ndarray, "4 4"]:
        """Camera to world; camera axes x right, y down, z forward."""
        return rigid_transform(data.cam_xmat[self._camera_id], data.cam_xpos[self._camera_id]) @ T_GL_CV

    @abstractmethod
    def render(self, data: mujoco.MjData) -> Image:
        """Colour and planar z [m] of the present state, in new arrays; NaN without a hit within the model's ``zfar``.

        ``data`` has body and camera poses up to date (``mj_kinematics`` and ``mj_camlight``, or ``mj_forward``). Raises
        RenderError after ``close``, where the camera holds resources.
        """

    def close(self) -> None:  # noqa: B027  Ray cameras have nothing to free.
        """Free all resources; may be called again."""

    def __enter__(self: _Self) -> _Self:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()
