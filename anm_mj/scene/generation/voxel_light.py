"""Voxel lighting, fast enough for buildings of forty rooms and without a ray caster.

An occupancy grid is blurred at several scales. Ambient light follows from the blurred grids at growing distances off
the surface (cone tracing, after Crassin et al., "Interactive indirect illumination using voxel cone tracing", 2011);
shadows of lamps and windows follow from steps through the finest grid.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32, Float64
from scipy import ndimage

from anm_mj.scene.generation.light import Light

VOXEL_M = 0.08
"""Edge of a voxel [m]: table legs still throw a shadow."""
_AMBIENT = 0.66
"""Share of an open surface's light that comes from all around."""
_CONE = ((0.11, 1, 0.30), (0.24, 3, 0.40), (0.5, 7, 0.45), (0.95, 13, 0.45))
"""Distance off the surface [m], width of the blur [voxels] and weight of what is solid there."""
_REACH_M = 6.0
"""Lights farther away than this are left out."""
_STEPS = 14
"""Places looked at between a surface and a light."""
_START_M = 0.13


class VoxelLighting:
    """Answers how much light falls on points of a building's surfaces."""

    def __init__(
        self,
        origin_m: Float64[np.ndarray, "3"],
        open_voxels: Bool[np.ndarray, "layers rows cols"],
        points_m: Float64[np.ndarray, "n 3"],
        lights: list[Light],
    ) -> None:
        """Mark what is solid and blur it.

        Args:
            origin_m: World coordinates of the outer corner of voxel [0, 0, 0].
            open_voxels: True inside rooms, as long as they are empty; layer along z, row along y, column along x.
            points_m: Points on all furniture, no farther apart than a voxel.
            lights: Lamps and windows.
        """
        solid = (~open_voxels).astype(np.float32)
        k, i, j = self._indices(points_m, origin_m, solid.shape)
        solid[k, i, j] = 1.0
        self._origin_m = origin_m
        self._levels: list[Float32[np.ndarray, "layers rows cols"]] = [
            solid if width == 1 else ndimage.uniform_filter(solid, width, mode="nearest") for _, width, _ in _CONE
        ]
        self._lights = lights

    def falling_on(
        self, points_m: Float64[np.ndarray, "n 3"], normals: Float64[np.ndarray, "n 3"]
    ) -> Float64[np.ndarray, "n 3"]:
        """Light per colour channel; 1 shows a surface in its own colour."""
        total = np.full(len(points_m), _AMBIENT)
        for (distance_m, _, weight), level in zip(_CONE, self._levels, strict=True):
            total *= 1.0 - weight * self._look_up(level, points_m + distance_m * normals)
        for light in self._lights:
            self._add_direct(total, points_m, normals, light)
        return np.repeat(total[:, None], 3, axis=1)

    def _add_direct(
        self,
        total: Float64[np.ndarray, " n"],
        points_m: Float64[np.ndarray, "n 3"],
        normals: Float64[np.ndarray, "n 3"],
        light: Light,
    ) -> None:
        """Add the light of one source, with soft shadows."""
        ray = np.array(light.centre_m) - points_m
        near = np.flatnonzero((ray**2).sum(axis=1) < _REACH_M**2)
        ray = ray[near]
        distance = np.linalg.norm(ray, axis=1)
        ray /= np.maximum(distance, 1e-9)[:, None]
        weight = np.clip((ray * normals[near]).sum(axis=1), 0.0, None) * np.clip(
            -ray @ np.array(light.normal), 0.0, None
        )
        lit = weight > 1e-3
        near, ray, distance, weight = near[lit], ray[lit], distance[lit], weight[lit]
        start = points_m[near] + _START_M * normals[near]
        # The last stretch before the source lies in the lamp or the window.
        reach = np.maximum(distance - 0.3, 0.0)
        seen = np.ones(len(near))
        for step in range(_STEPS):
            place = start + (reach * (step + 0.5) / _STEPS)[:, None] * ray
            seen *= 1.0 - 0.7 * self._look_up(self._levels[1], place)
        # The half metre squared keeps surfaces right beside a lamp from burning out.
        total[near] += seen * light.power * weight / (distance**2 + 0.25)

    def _look_up(
        self, level: Float32[np.ndarray, "layers rows cols"], points_m: Float64[np.ndarray, "n 3"]
    ) -> Float64[np.ndarray, " n"]:
        k, i, j = self._indices(points_m, self._origin_m, level.shape)
        return level[k, i, j].astype(np.float64)

    @staticmethod
    def _indices(
        points_m: Float64[np.ndarray, "n 3"], origin_m: Float64[np.ndarray, "3"], shape: tuple[int, ...]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Layer, row and column of the voxel of every point, or of the nearest voxel."""
        cells = ((points_m - origin_m) / VOXEL_M).astype(np.int64)
        return (
            np.clip(cells[:, 2], 0, shape[0] - 1),
            np.clip(cells[:, 1], 0, shape[1] - 1),
            np.clip(cells[:, 0], 0, shape[2] - 1),
        )
