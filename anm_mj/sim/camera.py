"""An RGB-D camera that draws colour and depth in one pass of MuJoCo's rasteriser.

``mujoco.Renderer`` draws the scene once for each; with MuJoCo's default quality (shadows, reflections, multisampling)
it is also an order of magnitude slower, and multisampling blends depths across edges.
"""

from __future__ import annotations

import logging
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco
import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from anm_mj.errors import RenderError
from anm_mj.frames import T_GL_CV
from anm_mj.sim.culling import Culling, worth_culling
from anm_mj.sim.gl import forget_backend
from anm_mj.types import Intrinsics

_logger = logging.getLogger(__name__)

VISIBLE_GROUPS = (0, 2)
"""Geom groups that the camera sees: 0, where MJCF puts geoms without a group, and 2, the scene's visual meshes. The
robot's own body (1) and the scene's collision boxes (3) are hidden."""

_MAX_GEOMS = 20_000
_FLAGS_OFF = ("SHADOW", "REFLECTION", "SKYBOX", "FOG", "HAZE", "WIREFRAME", "ADDITIVE")


class RgbdCamera:
    """Renders a model's camera; owns a GL context, so close it or use it in a ``with`` statement."""

    kind = "gl"

    def __init__(
        self,
        model: mujoco.MjModel,
        camera_name: str,
        width: int,
        height: int,
        *,
        cull_face: bool = True,
        visible_groups: tuple[int, ...] = VISIBLE_GROUPS,
        cull_hidden: bool | None = None,
    ):
        """Upload the model's meshes and textures to GL.

        Args:
            model: must not gain or lose geoms afterwards.
            camera_name: a perspective camera given by its vertical field of view.
            width: columns [px].
            height: rows [px].
            cull_face: leave out triangles seen from behind: a third faster, but walls modelled with one side only, or
                inside out, become transparent.
            visible_groups: geom groups that are drawn.
            cull_hidden: leave out meshes that are out of view or hidden; the pictures are the same, bit by bit. None:
                where there are enough of them for that to be faster.

        Raises:
            RenderError: if there is no such camera, or GL cannot make a picture.
        """
        self._camera_id = perspective_camera_id(model, camera_name)
        self._model = model
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._intrinsics = Intrinsics.from_fov(width, height, math.radians(model.cam_fovy[self._camera_id]))

        self._gl_context, self._mjr_context = _make_contexts(model, width, height)
        self._scene = mujoco.MjvScene(model, maxgeom=_MAX_GEOMS)
        for name in _FLAGS_OFF:
            self._scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{name}")] = 0
        self._scene.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE] = int(cull_face)
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = [group in visible_groups for group in range(mujoco.mjNGROUP)]
        self._hidden_group = next(group for group in range(mujoco.mjNGROUP) if group not in visible_groups)
        self._option.sitegroup[:] = 0
        self._viewpoint = mujoco.MjvCamera()
        self._viewpoint.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._viewpoint.fixedcamid = self._camera_id

        self._culling = None
        if worth_culling(model) if cull_hidden is None else cull_hidden:
            znear_m = model.vis.map.znear * model.stat.extent
            self._culling = Culling(model, self._intrinsics, visible_groups, znear_m=znear_m)
        self._rgb = np.empty((height, width, 3), np.uint8)
        self._depth = np.empty((height, width), np.float32)

    @property
    def intrinsics(self) -> Intrinsics:
        """The pinhole camera that the pictures obey exactly."""
        return self._intrinsics

    def render(self, data: mujoco.MjData) -> tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]:
        """Colour and depth as the camera sees them now, in new arrays.

        Args:
            data: with body and camera poses up to date (``mj_kinematics`` and ``mj_camlight``, or ``mj_forward``).

        Returns:
            RGB, and planar z [m], which is NaN where nothing was hit nearer than the model's ``zfar``.

        Raises:
            RenderError: after ``close``.
        """
        if self._gl_context is None:
            raise RenderError("This camera has been closed; make a new RgbdCamera to render again.")
        self._gl_context.make_current()
        if self._culling is None:
            return self._draw(data, np.zeros(0, np.int64))
        self._culling.begin(self.T_world_camera(data))
        while True:
            rgb, depth_m = self._draw(data, self._culling.not_drawn())
            if self._culling.accept(depth_m):
                return rgb, depth_m

    def _draw(
        self, data: mujoco.MjData, left_out: Int[np.ndarray, " n"]
    ) -> tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]:
        """Colour and depth of all visible geoms but some."""
        categories = mujoco.mjtCatBit.mjCAT_STATIC | mujoco.mjtCatBit.mjCAT_DYNAMIC
        groups = self._model.geom_group[left_out].copy()
        try:
            self._model.geom_group[left_out] = self._hidden_group
            mujoco.mjv_updateScene(self._model, data, self._option, None, self._viewpoint, categories, self._scene)
        finally:
            self._model.geom_group[left_out] = groups
        mujoco.mjr_render(self._rect, self._scene, self._mjr_context)
        mujoco.mjr_readPixels(self._rgb, self._depth, self._rect, self._mjr_context)
        # GL's first row is the lowest.
        return self._rgb[::-1].copy(), self._depth_m(self._depth[::-1])

    def T_world_camera(self, data: mujoco.MjData) -> Float[np.ndarray, "4 4"]:
        """Camera to world; camera axes x right, y down, z forward."""
        T_world_camera = np.eye(4)
        T_world_camera[:3, :3] = data.cam_xmat[self._camera_id].reshape(3, 3)
        T_world_camera[:3, 3] = data.cam_xpos[self._camera_id]
        return T_world_camera @ T_GL_CV

    def close(self) -> None:
        """Free what GL holds; may be called again."""
        if self._gl_context is not None:
            self._gl_context.make_current()
            self._mjr_context.free()
            self._gl_context.free()
            self._gl_context = None

    def __enter__(self) -> RgbdCamera:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    def _depth_m(self, buffer: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
        """Planar z from the contents of the reversed-z depth buffer, which is 0 where nothing was drawn.

        GL makes its projection matrix in float32. Rounding the same coefficients the same way here (as MuJoCo's own
        renderer does) keeps the result good to a hundredth of a millimetre, whatever znear and zfar are.
        """
        extent = self._model.stat.extent
        znear = np.float32(self._model.vis.map.znear * extent)
        zfar = np.float32(self._model.vis.map.zfar * extent)
        c = np.float32(-0.5) * (-(zfar + znear) / (zfar - znear)) - np.float32(0.5)
        d = np.float32(-0.5) * (-(np.float32(2) * zfar * znear) / (zfar - znear))
        depth_m = (d / (buffer.astype(np.float64) + c)).astype(np.float32)
        depth_m[buffer == 0.0] = np.nan
        return depth_m


def perspective_camera_id(model: mujoco.MjModel, name: str) -> int:
    """Raises RenderError unless the model has this camera and its picture follows from fovy alone."""
    camera_id = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, name)
    if camera_id < 0:
        known = [model.camera(i).name for i in range(model.ncam)]
        raise RenderError(
            f'The model has no camera "{name}"; it has {known}. Name one of these, or add it to the MJCF.'
        )
    if model.cam_sensorsize[camera_id].any():
        raise RenderError(f'Camera "{name}" is given by a sensor size; give it by its field of view (fovy) instead.')
    return camera_id


def _make_contexts(model: mujoco.MjModel, width: int, height: int) -> tuple[mujoco.GLContext, mujoco.MjrContext]:
    """GL and MuJoCo contexts with an off-screen buffer of this size.

    Raises:
        RenderError: if the back-end does not work (any more).
    """
    backend = os.environ.get("MUJOCO_GL", "")
    gl_context = None
    try:
        gl_context = mujoco.GLContext(width, height)
        gl_context.make_current()
        with _off_screen_quality(model, width, height):
            mjr_context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50)
    # Each back-end fails in its own way: ImportError, AttributeError, RuntimeError, OpenGL.error.GLError.
    except Exception as err:
        if gl_context is not None:
            gl_context.free()
        forget_backend(backend)
        raise RenderError(
            f"No picture can be made with MUJOCO_GL={backend or '(unset)'}: {err}. Call "
            "anm_mj.sim.gl.select_backend() before the first `import mujoco`; it finds a back-end that works."
        ) from err
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, mjr_context)
    mjr_context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
    return gl_context, mjr_context


@contextmanager
def _off_screen_quality(model: mujoco.MjModel, width: int, height: int) -> Iterator[None]:
    """Quality settings that a context takes from the model when it is made: one sample per pixel, no shadow map."""
    quality, buffer = model.vis.quality, model.vis.global_
    before = quality.offsamples, quality.shadowsize, buffer.offwidth, buffer.offheight
    quality.offsamples, quality.shadowsize, buffer.offwidth, buffer.offheight = 0, 0, width, height
    try:
        yield
    finally:
        quality.offsamples, quality.shadowsize, buffer.offwidth, buffer.offheight = before
