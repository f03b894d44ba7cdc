"""Rays against what somebody else moves, such as people: how far it is, and which pixels show it."""

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from anm_mj.ground_truth.reduced_depth import EVALUATION_SIDE_PX
from anm_mj.sim.render_mesh import mean_colours

_NEAREST_M = 1e-3
_FARTHEST_M = 1e3
_FACETS_M = 0.02
"""A rasteriser draws round parts as flat facets, which lie inside of them by less than this [m]."""


class MovedRays:
    """Casts rays of a camera at some geoms alone."""

    def __init__(self, model: mujoco.MjModel, geoms: Int[np.ndarray, " n"]) -> None:
        """Cast against ``geoms``, which are no meshes."""
        self._model, self._geoms = model, geoms
        groups = np.unique(model.geom_group[geoms])
        self._groups = np.isin(np.arange(mujoco.mjNGROUP), groups).astype(np.uint8)
        self._is_moved = np.isin(np.arange(model.ngeom), geoms)
        self._colours = (255.0 * mean_colours(model)).astype(np.float32)
        self._radius_m = model.geom_rbound[geoms]

    def hits(
        self, data: mujoco.MjData, T_world_camera: Float[np.ndarray, "4 4"], directions: Float[np.ndarray, "n 3"]
    ) -> tuple[Float32[np.ndarray, " n"], Float32[np.ndarray, "n 3"]]:
        """Planar depth of the geoms [m], NaN where a ray passes them by, and their colours from 0 to 255. Body poses of
        ``data`` are up to date; ``directions`` are rays in camera axes (x right, y down, z forward), scaled to z = 1.
        """
        depth_m, rgb = np.full(len(directions), np.nan, np.float32), np.zeros((len(directions), 3), np.float32)
        near = np.flatnonzero(self._may_hit(data, T_world_camera, directions))
        if not len(near):
            return depth_m, rgb
        rays = (directions[near] @ T_world_camera[:3, :3].T).ravel()
        geoms, distance = np.full(len(near), -1, np.int32), np.full(len(near), -1.0)
        args = T_world_camera[:3, 3].copy(), rays, self._groups, True, -1, geoms, distance, None, len(near), _FARTHEST_M
        mujoco.mj_multiRay(self._model, data, *args)
        hit = (geoms >= 0) & (distance > 0.0) & self._is_moved[geoms]
        depth_m[near[hit]], rgb[near[hit]] = distance[hit], self._colours[geoms[hit]]
        return depth_m, rgb

    def shown(
        self,
        data: mujoco.MjData,
        T_world_camera: Float[np.ndarray, "4 4"],
        directions: Float[np.ndarray, "h w 3"],
        depth_m: Float32[np.ndarray, "h w"],
    ) -> Bool[np.ndarray, "h w"]:
        """Which pixels of an image with this planar depth [m] show the geoms; other arguments as of :meth:`hits`.

        Images larger than what the evaluation reads are looked at in as few places.
        """
        rows, cols = (max(1, side // EVALUATION_SIDE_PX) for side in depth_m.shape)
        few = directions[::rows, ::cols]
        hit_m = self.hits(data, T_world_camera, few.reshape(-1, 3))[0].reshape(few.shape[:2])
        shown = hit_m < depth_m[::rows, ::cols] + np.float32(_FACETS_M)
        return np.repeat(np.repeat(shown, rows, axis=0), cols, axis=1)[: depth_m.shape[0], : depth_m.shape[1]]

    def _may_hit(
        self, data: mujoco.MjData, T_world_camera: Float[np.ndarray, "4 4"], directions: Float[np.ndarray, "n 3"]
    ) -> Bool[np.ndarray, " n"]:
        """The rays through the rectangles about the geoms' bounding spheres."""
        centre = (data.geom_xpos[self._geoms] - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
        found = np.zeros(len(directions), bool)
        for (x, y, z), radius in zip(centre.tolist(), self._radius_m.tolist(), strict=True):
            if z + radius <= 0.0:
                continue
            near, far = max(z - radius, _NEAREST_M), z + radius
            inside = np.ones(len(directions), bool)
            for axis, middle in enumerate((x, y)):
                low, high = middle - radius, middle + radius
                inside &= directions[:, axis] >= min(low / near, low / far)
                inside &= directions[:, axis] <= max(high / near, high / far)
            found |= inside
        return found
