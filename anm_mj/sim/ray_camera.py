"""Ray-casting cameras: one ray through each pixel centre, for machines without GL and for very large scenes.

Their depth is as exact as that of :class:`anm_mj.sim.gl_camera.GlCamera`. They see triangles from both sides.
"""

import mujoco
import numpy as np
from jaxtyping import Float32, Int32

from anm_mj.errors import RenderError
from anm_mj.frames import pixel_directions
from anm_mj.sim.camera import VISIBLE_GROUPS, Camera, Image
from anm_mj.sim.mipmap import MipmapTextures
from anm_mj.sim.moved_rays import MovedRays, cast_rays
from anm_mj.sim.render_mesh import are_static_meshes, mean_colours, render_mesh, visible_geoms
from anm_mj.utils.raycast import RayCaster


class _RayCamera(Camera):
    """Common part of the ray-casting cameras: rays, clipping planes and image assembly."""

    def __init__(self, model: mujoco.MjModel, camera_name: str, width: int, height: int):
        super().__init__(model, camera_name, width, height)
        self._directions = pixel_directions(self.intrinsics).reshape(-1, 3)
        self._znear_m = float(model.vis.map.znear * model.stat.extent)
        self._zfar_m = float(model.vis.map.zfar * model.stat.extent)

    def _images(self, rgb: Float32[np.ndarray, "n 3"], depth_m: Float32[np.ndarray, " n"]) -> Image:
        shape = (self.intrinsics.height, self.intrinsics.width)
        return (rgb + 0.5).clip(0.0, 255.0).astype(np.uint8).reshape(*shape, 3), depth_m.reshape(shape)


class EmbreeCamera(_RayCamera):
    """Casts rays with Embree, about as fast for a million triangles as for a thousand; sees static meshes and
    people only.
    """

    kind = "embree"

    def __init__(self, model: mujoco.MjModel, camera_name: str, width: int, height: int):
        """Build Embree's tree over all visible triangles; takes a second per million. Raises RenderError if there is no
        such camera, or a visible geom is not a static mesh, and RayCastError if Embree is not installed.
        """
        super().__init__(model, camera_name, width, height)
        moved, geoms = visible_geoms(model, moved=True), visible_geoms(model, moved=False)
        self._moved = MovedRays(model, moved) if len(moved) else None
        if not are_static_meshes(model, geoms):
            raise RenderError("Embree sees static meshes only; use MujocoRayCamera or GlCamera for this model.")
        mesh = render_mesh(model, geoms)
        self._mesh = mesh
        self._rays = RayCaster(mesh.vertices_m, mesh.faces)
        self._textures = MipmapTextures(mesh.textures)
        self._texels_per_m = _texels_per_m(mesh.vertices_m[mesh.faces], mesh.uv, mesh.texture, self._textures)
        self._pixel_size = np.float32(1.0 / self.intrinsics.fy)

    def render(self, data: mujoco.MjData) -> Image:
        """Render colour and depth; see :meth:`Camera.render`."""
        T_world_camera = self.T_world_camera(data)
        directions = (self._directions @ T_world_camera[:3, :3].T).astype(np.float32)
        # Rays start at the near plane: GL, too, draws nothing in front of it.
        origins = (T_world_camera[:3, 3] + self._znear_m * directions).astype(np.float32)
        hits = self._rays.hits(origins, directions)
        depth_m = hits["tfar"] + np.float32(self._znear_m)
        face = hits["primID"]
        missed = (face < 0) | (depth_m > self._zfar_m)
        depth_m[missed] = np.nan
        face = np.where(missed, 0, face)
        rgb = np.float32(255.0) * self._mesh.rgb[face]
        textured = np.flatnonzero((self._mesh.texture[face] >= 0) & ~missed)
        which = face[textured]
        u, v, corners = hits["u"][textured, None], hits["v"][textured, None], self._mesh.uv[which]
        uv = corners[:, 0] + u * (corners[:, 1] - corners[:, 0]) + v * (corners[:, 2] - corners[:, 0])
        normals, rays = hits["Ng"][textured], directions[textured]
        slant = np.abs(np.einsum("ij,ij->i", normals, rays))
        slant /= np.maximum(np.linalg.norm(normals, axis=1) * np.linalg.norm(rays, axis=1), 1e-20)
        pixel_m = depth_m[textured] * self._pixel_size / np.maximum(slant, 0.05)
        rgb[textured] *= (
            self._textures.sample(self._mesh.texture[which], uv, self._texels_per_m[which] * pixel_m) / 255.0
        )
        rgb[missed] = 0.0
        if self._moved is not None:
            moved_m, colours = self._moved.hits(data, T_world_camera, self._directions)
            nearer = (moved_m >= self._znear_m) & ~(depth_m <= moved_m)
            depth_m[nearer], rgb[nearer] = moved_m[nearer], colours[nearer]
        return self._images(rgb, depth_m)


class MujocoRayCamera(_RayCamera):
    """Casts rays with MuJoCo: needs no other package, takes tenths of a second, and gives each geom one colour."""

    kind = "mujoco rays"

    def __init__(self, model: mujoco.MjModel, camera_name: str, width: int, height: int):
        """Compute one colour per geom. Raises RenderError if there is no such camera."""
        super().__init__(model, camera_name, width, height)
        self._groups = np.array([group in VISIBLE_GROUPS for group in range(mujoco.mjNGROUP)], np.uint8)
        self._colours = 255.0 * mean_colours(model)

    def render(self, data: mujoco.MjData) -> Image:
        """Render colour and depth; see :meth:`Camera.render`."""
        cutoff_m = self._zfar_m * float(np.linalg.norm(self._directions, axis=1).max())
        view = self._model, data, self.T_world_camera(data), self._directions
        geoms, distance = cast_rays(*view, self._groups, cutoff_m)
        missed = (geoms < 0) | (distance < 0.0) | (distance > self._zfar_m)
        depth_m = np.where(missed, np.nan, distance).astype(np.float32)
        rgb = self._colours[geoms].astype(np.float32)
        rgb[missed] = 0.0
        return self._images(rgb, depth_m)


def _texels_per_m(
    corners_m: Float32[np.ndarray, "f 3 3"],
    uv: Float32[np.ndarray, "f 3 2"],
    texture: Int32[np.ndarray, " f"],
    textures: MipmapTextures,
) -> Float32[np.ndarray, " f"]:
    """Texture resolution of each face: the square root of its texels per square metre [px/m]."""
    size_px = textures.size_px(np.maximum(texture, 0))
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    area_px = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) * size_px.prod(axis=1)
    area_m2 = np.linalg.norm(np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0]), axis=1)
    return np.sqrt(area_px / np.maximum(area_m2, 1e-12)).astype(np.float32)
