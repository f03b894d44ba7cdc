"""Chooses and makes the fastest camera for a scene on this machine."""

import logging

import mujoco

from anm_mj.sim.camera import Camera
from anm_mj.sim.gl import GlBackend, require_unforked
from anm_mj.sim.gl_camera import GlCamera
from anm_mj.sim.ray_camera import EmbreeCamera, MujocoRayCamera
from anm_mj.sim.render_mesh import are_static_meshes, visible_geoms
from anm_mj.utils.raycast import embree_installed

_logger = logging.getLogger(__name__)

EMBREE_FROM_TRIANGLES = 1_500_000
"""From this number on, Embree is faster than a software renderer with culling: 60 ms of CPU time for any number of
triangles, against 8, 13 and 42 ms for 50, 225 and 1030 thousand (scripts/bench_camera.py)."""
_SOFTWARE_GL = ("llvmpipe", "softpipe", "swrast")


def make_camera(
    model: mujoco.MjModel, camera_name: str, width: int, height: int, *, cull_face: bool, backend: GlBackend
) -> Camera:
    """A camera of the kind that ``camera_kind`` chooses; other arguments as for :class:`Camera`.

    ``cull_face`` skips back faces, with GL only; ``backend`` is the selected GL back-end. Raises RenderError if there
    is no such camera, or GL has stopped working.
    """
    kind = camera_kind(model, backend)
    _logger.debug("camera: %s", kind)
    if kind == EmbreeCamera.kind:
        return EmbreeCamera(model, camera_name, width, height)
    if kind == MujocoRayCamera.kind:
        _logger.warning(
            "MuJoCo's ray caster renders the images: tenths of a second each and one colour per mesh. "
            "`pip install embreex` renders them ten times as fast and with textures."
        )
        return MujocoRayCamera(model, camera_name, width, height)
    require_unforked()
    return GlCamera(model, camera_name, width, height, cull_face=cull_face)


def camera_kind(model: mujoco.MjModel, backend: GlBackend) -> str:
    """``gl``, ``embree`` or ``mujoco rays``: depends on the scene, the installed packages and the GL renderer. The
    speed of the machine has no influence, so the same run gets the same images.
    """
    geoms = visible_geoms(model, moved=False)
    embree = embree_installed() and are_static_meshes(model, geoms)
    if backend.name == "off":
        return EmbreeCamera.kind if embree else MujocoRayCamera.kind
    software = any(name in backend.renderer_string.lower() for name in _SOFTWARE_GL)
    if embree and software and int(model.mesh_facenum[model.geom_dataid[geoms]].sum()) >= EMBREE_FROM_TRIANGLES:
        return EmbreeCamera.kind
    return GlCamera.kind
