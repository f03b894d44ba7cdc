"""Rays against what somebody else moves, such as people: how far it is, and which pixels show it."""

from collections.abc import Iterator

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int32, UInt8

from anm_mj.ground_truth.reduced_depth import EVALUATION_SIDE_PX
from anm_mj.sim.render_mesh import mean_colours

_NEAREST_M = 1e-3
_FARTHEST_M = 1e3
_ROUNDING_M = 1e-3
_FACETS_M = 0.02
"""A rasteriser draws round parts as flat facets, which lie inside of them by less than this [m]."""


def cast_rays(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    T_world_camera: Float[np.ndarray, "4 4"],
    directions: Float[np.ndarray, "n 3"],
    groups: UInt8[np.ndarray, " g"],
    farthest_m: float,
) -> tuple[Int32[np.ndarray, " n"], Float64[np.ndarray, " n"]]:
    """The geom that each ray of a camera hits first and where, as a multiple of its direction in camera axes; -1
    without one in these groups within a distance [m].
    """
    count, rays = len(directions), (directions @ T_world_camera[:3, :3].T).ravel()
    geoms, distance = np.full(count, -1, np.int32), np.full(count, -1.0)
    args = T_world_camera[:3, 3].copy(), rays, groups, True, -1, geoms, distance, None, count, farthest_m
    mujoco.mj_multiRay(model, data, *args)
    return geoms, distance


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
        found = np.zeros(len(directions), bool)
        for low, high, _ in self._boxes(data, T_world_camera):
            found |= ((directions[:, :2] >= low) & (directions[:, :2] <= high)).all(axis=1)
        depth_m, rgb = np.full(len(directions), np.nan, np.float32), np.zeros((len(directions), 3), np.float32)
        depth_m[found], rgb[found] = self._cast(data, T_world_camera, directions[found])
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
        few, few_m = directions[::rows, ::cols], depth_m[::rows, ::cols] + np.float32(_FACETS_M)
        shown = np.zeros(few_m.shape, bool)
        for low, high, nearest_m in self._boxes(data, T_world_camera):
            # x grows along the columns, y along the rows.
            across, down = (
                slice(np.searchsorted(axis, a), np.searchsorted(axis, b, "right"))
                for axis, a, b in zip((few[0, :, 0], few[:, 0, 1]), low, high, strict=True)
            )
            shown[down, across] |= few_m[down, across] > nearest_m - _ROUNDING_M
        near = np.nonzero(shown)
        # Where a geom is missed, its depth is NaN.
        shown[near] = self._cast(data, T_world_camera, few[near])[0] < few_m[near]
        return np.repeat(np.repeat(shown, rows, axis=0), cols, axis=1)[: depth_m.shape[0], : depth_m.shape[1]]

    def _cast(
        self, data: mujoco.MjData, T_world_camera: Float[np.ndarray, "4 4"], directions: Float[np.ndarray, "n 3"]
    ) -> tuple[Float32[np.ndarray, " n"], Float32[np.ndarray, "n 3"]]:
        """As :meth:`hits`, of rays that may all hit something."""
        depth_m, rgb = np.full(len(directions), np.nan, np.float32), np.zeros((len(directions), 3), np.float32)
        if not len(directions):
            return depth_m, rgb
        geoms, distance = cast_rays(self._model, data, T_world_camera, directions, self._groups, _FARTHEST_M)
        hit = (geoms >= 0) & (distance > 0.0) & self._is_moved[geoms]
        depth_m[hit], rgb[hit] = distance[hit], self._colours[geoms[hit]]
        return depth_m, rgb

    def _boxes(
        self, data: mujoco.MjData, T_world_camera: Float[np.ndarray, "4 4"]
    ) -> Iterator[tuple[tuple[float, float], tuple[float, float], float]]:
        """Of each geom's bounding sphere: the lowest and highest x and y of rays that may hit it, and its nearest depth
        [m]. Those behind the camera have none.
        """
        centre = (data.geom_xpos[self._geoms] - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
        for (x, y, z), radius in zip(centre.tolist(), self._radius_m.tolist(), strict=True):
            if z + radius <= 0.0:
                continue
            near, far = max(z - radius, _NEAREST_M), z + radius
            low = tuple(min((at - radius) / near, (at - radius) / far) for at in (x, y))
            high = tuple(max((at + radius) / near, (at + radius) / far) for at in (x, y))
            yield low, high, z - radius
