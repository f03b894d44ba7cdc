"""RGB-D cameras that cast one ray through the centre of each pixel, for where there is no GL or where that is slower.

Both give what :class:`anm_mj.sim.camera.RgbdCamera` gives. Depth is as exact. Triangles are seen from both sides.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
from jaxtyping import Float, Float32, Int32, UInt8

from anm_mj.errors import RenderError
from anm_mj.frames import T_GL_CV, pixel_directions
from anm_mj.sim.camera import VISIBLE_GROUPS, perspective_camera_id
from anm_mj.sim.mipmap import Texels
from anm_mj.sim.render_mesh import drawn_mesh, mean_colours, still_meshes, visible_geoms
from anm_mj.types import Intrinsics
from anm_mj.utils.raycast import RayCaster


class _RayCamera:
    """What both have in common; holds nothing that must be freed."""

    def __init__(self, model: mujoco.MjModel, camera_name: str, width: int, height: int):
        self._camera_id = perspective_camera_id(model, camera_name)
        self._model = model
        self._intrinsics = Intrinsics.from_fov(width, height, math.radians(model.cam_fovy[self._camera_id]))
        self._directions = pixel_directions(self._intrinsics).reshape(-1, 3)
        self._znear_m = float(model.vis.map.znear * model.stat.extent)
        self._zfar_m = float(model.vis.map.zfar * model.stat.extent)

    @property
    def intrinsics(self) -> Intrinsics:
        """The pinhole camera that the pictures obey exactly."""
        return self._intrinsics

    def T_world_camera(self, data: mujoco.MjData) -> Float[np.ndarray, "4 4"]:
        """Camera to world; camera axes x right, y down, z forward."""
        T_world_camera = np.eye(4)
        T_world_camera[:3, :3] = data.cam_xmat[self._camera_id].reshape(3, 3)
        T_world_camera[:3, 3] = data.cam_xpos[self._camera_id]
        return T_world_camera @ T_GL_CV

    def close(self) -> None:
        """Nothing is held."""

    def _pictures(
        self, rgb: Float32[np.ndarray, "n 3"], depth_m: Float32[np.ndarray, " n"]
    ) -> tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]:
        """Colours in 0..255 and depths as pictures; black and NaN where nothing was hit."""
        shape = (self._intrinsics.height, self._intrinsics.width)
        return (rgb + 0.5).clip(0.0, 255.0).astype(np.uint8).reshape(*shape, 3), depth_m.reshape(shape)


class EmbreeCamera(_RayCamera):
    """Casts rays with Embree: as fast for a million triangles as for a thousand. Sees meshes that stand still only."""

    kind = "embree"

    def __init__(
        self,
        model: mujoco.MjModel,
        camera_name: str,
        width: int,
        height: int,
        *,
        visible_groups: tuple[int, ...] = VISIBLE_GROUPS,
    ):
        """Hand all visible triangles to Embree; a second for a million.

        Raises:
            RenderError: if there is no such camera, or something visible is not a mesh that stands still.
        """
        super().__init__(model, camera_name, width, height)
        geoms = visible_geoms(model, visible_groups)
        if not len(geoms) or not still_meshes(model, geoms).all():
            raise RenderError("Embree sees meshes that stand still only; use RayCamera or RgbdCamera for this model.")
        mesh = drawn_mesh(model, geoms)
        self._mesh = mesh
        self._rays = RayCaster(mesh.vertices_m, mesh.faces)
        self._texels = Texels(mesh.textures)
        self._texels_per_m = _texels_per_m(mesh.vertices_m[mesh.faces], mesh.uv, mesh.texture, self._texels)
        self._pixel_size = np.float32(1.0 / self._intrinsics.fy)

    def render(self, data: mujoco.MjData) -> tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]:
        """Colour and depth as the camera sees them now, in new arrays.

        Args:
            data: with camera poses up to date (``mj_kinematics`` and ``mj_camlight``, or ``mj_forward``).

        Returns:
            RGB, and planar z [m], which is NaN where nothing was hit nearer than the model's ``zfar``.
        """
        T_world_camera = self.T_world_camera(data)
        directions = (self._directions @ T_world_camera[:3, :3].T).astype(np.float32)
        # Rays begin at the near plane, before which GL draws nothing either.
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
        rgb[textured] *= self._texels.at(self._mesh.texture[which], uv, self._texels_per_m[which] * pixel_m) / 255.0
        rgb[missed] = 0.0
        return self._pictures(rgb, depth_m)

    def __enter__(self) -> EmbreeCamera:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()


class RayCamera(_RayCamera):
    """Casts rays with MuJoCo itself: needs nothing, takes tenths of a second, and gives each geom one colour."""

    kind = "mujoco rays"

    def __init__(
        self,
        model: mujoco.MjModel,
        camera_name: str,
        width: int,
        height: int,
        *,
        visible_groups: tuple[int, ...] = VISIBLE_GROUPS,
    ):
        """Work out the colours.

        Raises:
            RenderError: if there is no such camera.
        """
        super().__init__(model, camera_name, width, height)
        self._groups = np.array([group in visible_groups for group in range(mujoco.mjNGROUP)], np.uint8)
        self._colours = 255.0 * mean_colours(model)

    def render(self, data: mujoco.MjData) -> tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]:
        """Colour and depth as the camera sees them now; see ``EmbreeCamera.render``."""
        T_world_camera = self.T_world_camera(data)
        directions = self._directions @ T_world_camera[:3, :3].T
        num = len(directions)
        geoms, distance = np.full(num, -1, np.int32), np.full(num, -1.0)
        cutoff_m = self._zfar_m * float(np.linalg.norm(self._directions, axis=1).max())
        position = T_world_camera[:3, 3].copy()
        mujoco.mj_multiRay(
            self._model,
            data,
            position,
            directions.ravel(),
            self._groups,
            True,
            -1,
            geoms,
            distance,
            None,
            num,
            cutoff_m,
        )
        missed = (geoms < 0) | (distance < 0.0) | (distance > self._zfar_m)
        depth_m = np.where(missed, np.nan, distance).astype(np.float32)
        rgb = self._colours[geoms].astype(np.float32)
        rgb[missed] = 0.0
        return self._pictures(rgb, depth_m)

    def __enter__(self) -> RayCamera:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()


def _texels_per_m(
    corners_m: Float32[np.ndarray, "f 3 3"],
    uv: Float32[np.ndarray, "f 3 2"],
    texture: Int32[np.ndarray, " f"],
    texels: Texels,
) -> Float32[np.ndarray, " f"]:
    """How finely each face is textured: the square root of its texels per square metre."""
    size_px = texels.size_px(np.maximum(texture, 0))
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    area_px = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) * size_px.prod(axis=1)
    area_m2 = np.linalg.norm(np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0]), axis=1)
    return np.sqrt(area_px / np.maximum(area_m2, 1e-12)).astype(np.float32)
