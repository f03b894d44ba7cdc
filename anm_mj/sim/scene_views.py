"""Renders a scene without a robot: top view, interior views, and a test for single-sided walls."""

import math
from contextlib import closing
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float32, UInt8

from anm_mj.mjcf.poses import quaternion_of
from anm_mj.scene.build import build_spec, compile_scene
from anm_mj.scene.folder import Scene
from anm_mj.sim.camera import Camera, Image
from anm_mj.sim.camera_factory import make_camera
from anm_mj.sim.gl import GlBackend
from anm_mj.sim.gl_camera import GlCamera
from anm_mj.sim.ray_camera import EmbreeCamera, MujocoRayCamera
from anm_mj.sim.render_mesh import are_static_meshes, visible_geoms
from anm_mj.types import Pose2
from anm_mj.utils.raycast import embree_installed

EYE_HEIGHT_M = 1.25
CUT_M = 2.0
"""The top view omits everything above this height [m]."""
NOTHING = (238, 240, 243)
"""Colour of the top view where nothing is; walls and floors may be white."""
_COMPARED_PX = 96
_SAME_M = 0.02
"""Depths that differ by more belong to different surfaces [m]."""
_EXACT_M = 0.001


@dataclass(frozen=True)
class BackfaceCheck:
    """Comparison of rendered depth with cast rays, which hit both sides of a triangle."""

    changed_fraction: float
    """Fraction of pixels that back-face culling changes."""
    exact_fraction: float
    """Fraction of pixels within a millimetre of the ray through their centre, without culling."""


class SceneViews:
    """Renders a scene from arbitrary poses."""

    def __init__(self, scene: Scene, backend: GlBackend):
        """Compile the scene; ray casting renders where the GL back-end is off. Raises SceneError if the scene cannot be
        compiled.
        """
        self._scene, self._backend = scene, backend
        spec = build_spec(scene)
        eye = spec.worldbody.add_body(name="eye", mocap=True)
        # Level, its axes x right, y up and z backward.
        axes = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
        eye.add_camera(name="eye", fovy=90.0, quat=quaternion_of(axes))
        width_m = float(np.ptp(scene.bounds_m[:, :2], axis=0).max()) + 0.5
        # From so far away that floor and cut have nearly the same scale, and the picture fits the plan.
        self._height_m = 30.0 * width_m
        fovy = math.degrees(2.0 * math.atan(width_m / 2.0 / (self._height_m - CUT_M / 2.0)))
        x, y = scene.bounds_m[:, :2].mean(axis=0)
        self.top_corners_m = np.array([[x, y], [x, y]]) + np.array([[-0.5], [0.5]]) * width_m
        """South-west and north-east corner of the top view, world [m]."""
        spec.worldbody.add_camera(name="above", fovy=fovy, pos=[x, y, self._height_m])
        self._model = compile_scene(spec, scene)
        self._data = mujoco.MjData(self._model)
        # The scene may have mocap bodies of its own.
        self._eye = int(self._model.body("eye").mocapid[0])

    def interior_views(self, poses: tuple[Pose2, ...], size_px: int = 256) -> list[UInt8[np.ndarray, "_ _ 3"]]:
        """Colour images from camera height above poses on the floor."""
        camera = make_camera(
            self._model, "eye", size_px, size_px, cull_face=self._scene.cull_face, backend=self._backend
        )
        with closing(camera):
            return [self._render_from(camera, pose)[0] for pose in poses]

    def top_view(self, size_px: int = 768) -> UInt8[np.ndarray, "h w 3"]:
        """Colour image from above, cut at a height of 2 m; x to the right and y up, light where nothing is."""
        vis = self._model.vis.map
        before = vis.znear, vis.zfar
        vis.znear, vis.zfar = self._height_m - CUT_M, self._height_m + 10.0
        try:
            camera = make_camera(self._model, "above", size_px, size_px, cull_face=False, backend=self._backend)
            with closing(camera):
                rgb, depth_m = self._render(camera)
                return np.where(np.isnan(depth_m)[..., None], np.array(NOTHING, np.uint8), rgb)
        finally:
            vis.znear, vis.zfar = before

    def check_backfaces(self, poses: tuple[Pose2, ...]) -> BackfaceCheck | None:
        """Compare GL images, with and without back-face culling, with cast rays; None without GL."""
        if self._backend.name == "off":
            return None
        size = (_COMPARED_PX, _COMPARED_PX)
        # Embree sees static meshes only.
        embree = embree_installed() and are_static_meshes(self._model, visible_geoms(self._model, moved=False))
        caster = (EmbreeCamera if embree else MujocoRayCamera)(self._model, "eye", *size)
        with (
            GlCamera(self._model, "eye", *size, cull_face=False) as both,
            GlCamera(self._model, "eye", *size, cull_face=True) as one,
        ):
            fractions = []
            for pose in poses:
                cast_m = self._render_from(caster, pose)[1]
                both_m, one_m = self._render_from(both, pose)[1], self._render_from(one, pose)[1]
                fractions.append((1.0 - _same(both_m, one_m, _SAME_M), _same(both_m, cast_m, _EXACT_M)))
        changed, exact = np.mean(fractions, axis=0)
        return BackfaceCheck(float(changed), float(exact))

    def _render_from(self, camera: Camera, pose: Pose2) -> Image:
        self._data.mocap_pos[self._eye] = (pose.x_m, pose.y_m, EYE_HEIGHT_M)
        half = pose.yaw_rad / 2
        self._data.mocap_quat[self._eye] = (math.cos(half), 0.0, 0.0, math.sin(half))
        return self._render(camera)

    def _render(self, camera: Camera) -> Image:
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        return camera.render(self._data)


def _same(a: Float32[np.ndarray, "h w"], b: Float32[np.ndarray, "h w"], tolerance_m: float) -> float:
    return float(((np.abs(a - b) < tolerance_m) | (np.isnan(a) & np.isnan(b))).mean())
