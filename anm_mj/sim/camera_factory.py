"""The ways of making pictures behind one seam, and the choice among them."""

from __future__ import annotations

import logging
from typing import Protocol, runtime_checkable

import mujoco
import numpy as np
from jaxtyping import Float, Float32, UInt8

from anm_mj.sim.camera import VISIBLE_GROUPS, RgbdCamera
from anm_mj.sim.gl import GlBackend, require_unforked
from anm_mj.sim.ray_camera import EmbreeCamera, RayCamera
from anm_mj.sim.render_mesh import still_meshes, visible_geoms
from anm_mj.types import Intrinsics
from anm_mj.utils.raycast import embree_installed

_logger = logging.getLogger(__name__)

EMBREE_FROM_TRIANGLES = 1_500_000
"""From here on Embree is faster than a software renderer that draws only what can be seen: 60 ms of processor time for
any number of triangles, against 8, 13 and 42 ms for 50, 225 and 1030 thousand (scripts/bench_camera.py)."""
_SOFTWARE_GL = ("llvmpipe", "softpipe", "swrast")


@runtime_checkable
class Camera(Protocol):
    """Makes pictures of a simulated world."""

    kind: str
    """How: ``gl``, ``embree`` or ``mujoco rays``."""

    @property
    def intrinsics(self) -> Intrinsics:
        """The pinhole camera that the pictures obey exactly."""
        ...

    def render(self, data: mujoco.MjData) -> tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]:
        """RGB, and planar z [m] with NaN where nothing was hit, as seen now."""
        ...

    def T_world_camera(self, data: mujoco.MjData) -> Float[np.ndarray, "4 4"]:
        """Camera to world; camera axes x right, y down, z forward."""
        ...

    def close(self) -> None:
        """Free what is held; may be called again."""
        ...


def make_camera(
    model: mujoco.MjModel, camera_name: str, width: int, height: int, *, cull_face: bool, backend: GlBackend
) -> Camera:
    """The fastest camera that works here; see ``camera_kind``.

    Args:
        model: the simulated world.
        camera_name: a perspective camera given by its vertical field of view.
        width: columns [px].
        height: rows [px].
        cull_face: leave out triangles seen from behind, where that makes a difference in time.
        backend: what GL was found.

    Raises:
        RenderError: if there is no such camera, or GL fails although it has worked before.
    """
    kind = camera_kind(model, backend)
    _logger.debug("pictures by %s", kind)
    if kind == EmbreeCamera.kind:
        return EmbreeCamera(model, camera_name, width, height)
    if kind == RayCamera.kind:
        _logger.warning(
            "Pictures are made by MuJoCo's rays: tenths of a second each and one colour per mesh. "
            "`pip install 'anm-mj[embree]'` makes them ten times as fast and with textures."
        )
        return RayCamera(model, camera_name, width, height)
    require_unforked()
    return RgbdCamera(model, camera_name, width, height, cull_face=cull_face)


def camera_kind(model: mujoco.MjModel, backend: GlBackend) -> str:
    """``gl``, ``embree`` or ``mujoco rays``: follows from the scene, what is installed and whether GL is a GPU.

    How fast the machine happens to be does not enter, so that the same run is made of the same pictures.
    """
    geoms = visible_geoms(model, VISIBLE_GROUPS)
    embree = embree_installed() and len(geoms) > 0 and bool(still_meshes(model, geoms).all())
    if backend.name == "off":
        return EmbreeCamera.kind if embree else RayCamera.kind
    software = any(name in backend.renderer_string.lower() for name in _SOFTWARE_GL)
    if embree and software and int(model.mesh_facenum[model.geom_dataid[geoms]].sum()) >= EMBREE_FROM_TRIANGLES:
        return EmbreeCamera.kind
    return RgbdCamera.kind
