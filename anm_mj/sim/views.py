"""Pictures of a scene without a robot: from above, from within, and compared with rays to find walls of one side."""

from __future__ import annotations

import math
from contextlib import closing
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float32, UInt8

from anm_mj.scene.build import build_spec, compile_scene
from anm_mj.scene.folder import Scene
from anm_mj.sim.camera import RgbdCamera
from anm_mj.sim.camera_factory import Camera, make_camera
from anm_mj.sim.gl import GlBackend
from anm_mj.sim.ray_camera import EmbreeCamera, RayCamera
from anm_mj.types import Pose2
from anm_mj.utils.raycast import embree_installed

EYE_HEIGHT_M = 1.25
_CUT_M = 2.0
"""What is higher is left out of the view from above [m]."""
_COMPARED_PX = 96
_SAME_M = 0.02
"""Depths that differ by more show different surfaces [m]."""
_EXACT_M = 0.001


@dataclass(frozen=True)
class Sides:
    """What comparing drawn depth with rays, which hit both sides of a triangle, has shown."""

    one_sided_share: float
    """Share of pixels that change when triangles seen from behind are left out."""
    exact_share: float
    """Share of pixels that are within a millimetre of the ray through their centre when all are drawn."""


class SceneViews:
    """Takes pictures of a scene from anywhere."""

    def __init__(self, scene: Scene, backend: GlBackend):
        """Compile the scene.

        Args:
            scene: what to look at.
            backend: what GL was found; without any, rays are cast.

        Raises:
            SceneError: if the scene cannot be compiled.
        """
        self._scene, self._backend = scene, backend
        spec = build_spec(scene)
        eye = spec.worldbody.add_body(name="eye", mocap=True)
        eye.add_camera(name="eye", fovy=90.0, quat=_quat((0.0, -1.0, 0.0)))
        width_m = float(np.ptp(scene.bounds_m[:, :2], axis=0).max()) + 0.5
        self._height_m = 3.0 * width_m
        fovy = math.degrees(2.0 * math.atan(width_m / 2.0 / (self._height_m - _CUT_M)))
        x, y = scene.bounds_m[:, :2].mean(axis=0)
        spec.worldbody.add_camera(name="above", fovy=fovy, pos=[x, y, self._height_m])
        self._model = compile_scene(spec, scene)
        self._data = mujoco.MjData(self._model)

    def from_within(self, poses: tuple[Pose2, ...], size_px: int = 256) -> list[UInt8[np.ndarray, "_ _ 3"]]:
        """What the robot's camera would see from places in the scene."""
        camera = make_camera(
            self._model, "eye", size_px, size_px, cull_face=self._scene.cull_face, backend=self._backend
        )
        with closing(camera):
            return [self._look(camera, pose)[0] for pose in poses]

    def from_above(self, size_px: int = 512) -> UInt8[np.ndarray, "h w 3"]:
        """The scene cut at 2 m and looked down into, x to the right and y up."""
        vis = self._model.vis.map
        before = vis.znear, vis.zfar
        vis.znear, vis.zfar = self._height_m - _CUT_M, self._height_m + 10.0
        try:
            camera = make_camera(self._model, "above", size_px, size_px, cull_face=False, backend=self._backend)
            with closing(camera):
                mujoco.mj_kinematics(self._model, self._data)
                mujoco.mj_camlight(self._model, self._data)
                return camera.render(self._data)[0]
        finally:
            vis.znear, vis.zfar = before

    def sides(self, poses: tuple[Pose2, ...]) -> Sides | None:
        """Compare drawing with casting rays from some places; None where nothing can be drawn."""
        if self._backend.name == "off":
            return None
        size = (_COMPARED_PX, _COMPARED_PX)
        caster = (EmbreeCamera if embree_installed() else RayCamera)(self._model, "eye", *size)
        with (
            RgbdCamera(self._model, "eye", *size, cull_face=False) as both,
            RgbdCamera(self._model, "eye", *size, cull_face=True) as one,
        ):
            shares = []
            for pose in poses:
                cast_m = self._look(caster, pose)[1]
                both_m, one_m = self._look(both, pose)[1], self._look(one, pose)[1]
                shares.append((1.0 - _same(both_m, one_m, _SAME_M), _same(both_m, cast_m, _EXACT_M)))
        one_sided, exact = np.mean(shares, axis=0)
        return Sides(float(one_sided), float(exact))

    def _look(self, camera: Camera, pose: Pose2) -> tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]:
        """Put the eye above a pose and take a picture."""
        self._data.mocap_pos[0] = (pose.x_m, pose.y_m, EYE_HEIGHT_M)
        self._data.mocap_quat[0] = (math.cos(pose.yaw_rad / 2), 0.0, 0.0, math.sin(pose.yaw_rad / 2))
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        return camera.render(self._data)


def _same(a: Float32[np.ndarray, "h w"], b: Float32[np.ndarray, "h w"], tolerance_m: float) -> float:
    """Share of pixels with the same depth, or none in both."""
    return float(((np.abs(a - b) < tolerance_m) | (np.isnan(a) & np.isnan(b))).mean())


def _quat(right: tuple[float, float, float]) -> list[float]:
    """Orientation of a level camera with this direction to its right."""
    up, quat = np.array([0.0, 0.0, 1.0]), np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.stack([np.array(right), up, np.cross(right, up)], axis=1).ravel())
    return quat.tolist()
