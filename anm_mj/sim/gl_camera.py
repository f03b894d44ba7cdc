"""The GL camera: renders colour and depth in one pass of MuJoCo's rasteriser.

``mujoco.Renderer`` needs one pass for each. Its default quality (shadows, reflections, multisampling) is an order of
magnitude slower, and multisampling blends depths across edges.
"""

# Without GL, mujoco has no GLContext.
from __future__ import annotations

import atexit
import functools
import os
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import mujoco
import numpy as np
from jaxtyping import Float32, Int

from anm_mj.errors import RenderError
from anm_mj.sim.camera import VISIBLE_GROUPS, Camera, Image
from anm_mj.sim.culling import Culling, is_worth_culling
from anm_mj.sim.gl import forget_backend
from anm_mj.sim.mipmap import smooth_mipmaps

_MAX_GEOMS = 20_000
_FLAGS_OFF = ("SHADOW", "REFLECTION", "SKYBOX", "FOG", "HAZE", "WIREFRAME", "ADDITIVE")


class GlCamera(Camera):
    """Renders by GL; owns a GL context."""

    kind = "gl"

    def __init__(
        self,
        model: mujoco.MjModel,
        camera_name: str,
        width: int,
        height: int,
        *,
        cull_face: bool = True,
        cull_hidden: bool | None = None,
    ):
        """Upload the model's meshes and textures to GL; its number of geoms must not change afterwards.

        ``cull_face`` skips back faces: a third faster, but single-sided walls become transparent from behind.
        ``cull_hidden`` skips meshes that are out of view or occluded, with bit-identical images; None: only for models
        with enough triangles to save time. Other arguments as for :class:`Camera`. Raises RenderError if there is no
        such camera, or GL cannot render.
        """
        super().__init__(model, camera_name, width, height)
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._gl_context, self._mjr_context = _make_contexts(model, width, height)
        # A camera that nobody closed is closed before EGL ends with the program, which would be an error afterwards.
        self._at_exit = functools.partial(_close, weakref.ref(self))
        atexit.register(self._at_exit)
        self._scene = mujoco.MjvScene(model, maxgeom=_MAX_GEOMS)
        for name in _FLAGS_OFF:
            self._scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{name}")] = 0
        self._scene.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE] = int(cull_face)
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = [group in VISIBLE_GROUPS for group in range(mujoco.mjNGROUP)]
        self._hidden_group = next(group for group in range(mujoco.mjNGROUP) if group not in VISIBLE_GROUPS)
        self._option.sitegroup[:] = 0
        self._viewpoint = mujoco.MjvCamera()
        self._viewpoint.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._viewpoint.fixedcamid = self._camera_id

        self.culling: Culling | None = None
        """Selects the meshes to render; None if the camera always renders all of them."""
        if is_worth_culling(model) if cull_hidden is None else cull_hidden:
            znear_m = model.vis.map.znear * model.stat.extent
            self.culling = Culling(model, self.intrinsics, znear_m=znear_m)
        self._rgb = np.empty((height, width, 3), np.uint8)
        self._depth = np.empty((height, width), np.float32)

    def render(self, data: mujoco.MjData) -> Image:
        """Render colour and depth; see :meth:`Camera.render`."""
        if self._gl_context is None:
            raise RenderError("This camera is closed; make a new GlCamera to render again.")
        _make_current(self._gl_context)
        if self.culling is None:
            return self._draw(data, np.zeros(0, np.int64))
        self.culling.start_image(self.T_world_camera(data))
        while True:
            rgb, depth_m = self._draw(data, self.culling.skipped_geoms())
            if self.culling.accept(depth_m):
                return rgb, depth_m

    def _draw(self, data: mujoco.MjData, skipped: Int[np.ndarray, " n"]) -> Image:
        categories = mujoco.mjtCatBit.mjCAT_STATIC | mujoco.mjtCatBit.mjCAT_DYNAMIC
        groups = self._model.geom_group[skipped].copy()
        try:
            self._model.geom_group[skipped] = self._hidden_group
            mujoco.mjv_updateScene(self._model, data, self._option, None, self._viewpoint, categories, self._scene)
        finally:
            self._model.geom_group[skipped] = groups
        mujoco.mjr_render(self._rect, self._scene, self._mjr_context)
        mujoco.mjr_readPixels(self._rgb, self._depth, self._rect, self._mjr_context)
        # GL stores the lowest row first.
        return self._rgb[::-1].copy(), self._depth_m(self._depth[::-1])

    def close(self) -> None:
        """Free the GL context, if not done yet. Raises RenderError if a running thread has rendered with it."""
        if self._gl_context is not None:
            _make_current(self._gl_context)
            self._mjr_context.free()
            self._gl_context.free()
            self._gl_context = None
            atexit.unregister(self._at_exit)

    def _depth_m(self, buffer: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
        """Planar z [m] from the reversed-z depth buffer, which is 0 at pixels without geometry.

        GL computes its projection matrix in float32. Rounding the same coefficients the same way (as MuJoCo's own
        renderer does) keeps the error below a hundredth of a millimetre for any znear and zfar.
        """
        extent = self._model.stat.extent
        znear = np.float32(self._model.vis.map.znear * extent)
        zfar = np.float32(self._model.vis.map.zfar * extent)
        c = np.float32(-0.5) * (-(zfar + znear) / (zfar - znear)) - np.float32(0.5)
        d = np.float32(-0.5) * (-(np.float32(2) * zfar * znear) / (zfar - znear))
        depth_m = (d / (buffer.astype(np.float64) + c)).astype(np.float32)
        depth_m[buffer == 0.0] = np.nan
        return depth_m


def _close(camera: weakref.ref[GlCamera]) -> None:
    if (open_one := camera()) is not None:
        with suppress(RenderError):
            open_one.close()


def _make_current(context: mujoco.GLContext) -> None:
    """Let this thread render with a context; raises RenderError while another thread holds it."""
    try:
        context.make_current()
    except Exception as err:  # Back-ends raise different exceptions.
        raise RenderError(
            "The GL context of this simulation belongs to the thread that made it, and this is another one: reset, "
            "step, render and close an environment or a robot in one thread."
        ) from err


def _make_contexts(model: mujoco.MjModel, width: int, height: int) -> tuple[mujoco.GLContext, mujoco.MjrContext]:
    """GL and MuJoCo contexts with an off-screen buffer of this size."""
    backend = os.environ.get("MUJOCO_GL", "")
    gl_context = None
    try:
        gl_context = mujoco.GLContext(width, height)
        gl_context.make_current()
        with _off_screen_quality(model, width, height):
            mjr_context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50)
        smooth_mipmaps(mjr_context)
    # Back-ends raise different exceptions: ImportError, AttributeError, RuntimeError, OpenGL.error.GLError.
    except Exception as err:
        if gl_context is not None:
            gl_context.free()
        forget_backend(backend)
        raise RenderError(
            f"No image can be rendered with MUJOCO_GL={backend or '(unset)'}: {err}. Call "
            "anm_mj.sim.gl.select_backend() before the first `import mujoco`; it finds a back-end that works."
        ) from err
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, mjr_context)
    mjr_context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
    return gl_context, mjr_context


@contextmanager
def _off_screen_quality(model: mujoco.MjModel, width: int, height: int) -> Iterator[None]:
    """Set the quality that a new context reads from the model: one sample per pixel, no shadow map."""
    quality, buffer = model.vis.quality, model.vis.global_
    before = quality.offsamples, quality.shadowsize, buffer.offwidth, buffer.offheight
    quality.offsamples, quality.shadowsize, buffer.offwidth, buffer.offheight = 0, 0, width, height
    try:
        yield
    finally:
        quality.offsamples, quality.shadowsize, buffer.offwidth, buffer.offheight = before
