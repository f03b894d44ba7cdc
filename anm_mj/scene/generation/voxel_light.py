"""Voxel lighting by lamps and windows, fast enough for buildings of forty rooms and without a ray caster.

An occupancy grid is blurred at several scales. Ambient light follows from the blurred grids at growing distances off
the surface (cone tracing, after Crassin et al., "Interactive indirect illumination using voxel cone tracing", 2011);
shadows of lamps and windows follow from steps through the finest grid.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64
from scipy import ndimage

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
_Numbers = Float64[np.ndarray, " n"]
_Vectors = Float64[np.ndarray, "n 3"]
_Voxels = Float32[np.ndarray, "layers rows cols"]


@dataclass(frozen=True)
class Light:
    """A lamp or window that shines towards its normal."""

    centre_m: tuple[float, float, float]
    normal: tuple[float, float, float]
    power: float
    """Radiance times area, in units in which a white surface 1 m away, face to face, is about fully lit by 1."""


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

        ``origin_m`` is the outer corner of voxel [0, 0, 0] in the world; ``open_voxels`` (layer along z, row along y,
        column along x) are true inside empty rooms; ``points_m`` lie all over the furniture, no farther apart than a
        voxel.
        """
        solid = (~open_voxels).astype(np.float32)
        self._origin_m = origin_m
        solid[self._indices(points_m, solid.shape)] = 1.0
        self._levels: list[_Voxels] = [
            solid if width == 1 else ndimage.uniform_filter(solid, width, mode="nearest") for _, width, _ in _CONE
        ]
        self._lights = lights

    def falling_on(self, points_m: _Vectors, normals: _Vectors) -> _Numbers:
        """White light on points [m] of surfaces; 1 shows a surface in its own colour."""
        total = np.full(len(points_m), _AMBIENT)
        for (distance_m, _, weight), level in zip(_CONE, self._levels, strict=True):
            total *= 1.0 - weight * self._look_up(level, points_m + distance_m * normals)
        for light in self._lights:
            self._add_direct(total, points_m, normals, light)
        return total

    def _add_direct(self, total: _Numbers, points_m: _Vectors, normals: _Vectors, light: Light) -> None:
        ray = np.array(light.centre_m) - points_m
        near = np.flatnonzero((ray**2).sum(axis=1) < _REACH_M**2)
        ray = ray[near]
        distance = np.linalg.norm(ray, axis=1)
        ray /= np.maximum(distance, 1e-9)[:, None]
        weight = np.clip((ray * normals[near]).sum(axis=1), 0.0, None)
        weight *= np.clip(-ray @ np.array(light.normal), 0.0, None)
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

    def _look_up(self, level: _Voxels, points_m: _Vectors) -> _Numbers:
        return level[self._indices(points_m, level.shape)].astype(np.float64)

    def _indices(self, points_m: _Vectors, shape: tuple[int, ...]) -> tuple[np.ndarray, ...]:
        """Layer, row and column of the voxel of every point, or of the nearest voxel."""
        cells = ((points_m - self._origin_m) / VOXEL_M).astype(np.int64)
        return tuple(np.clip(cells[:, 2 - axis], 0, shape[axis] - 1) for axis in range(3))


def to_srgb(linear: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    """SRGB values in 0..1 of light intensities; what is brighter than white is eased towards it."""
    soft = np.where(linear < 0.8, linear, 0.8 + 0.2 * np.tanh((linear - 0.8) / 0.2 * 0.8))
    return np.clip(soft, 0.0, 1.0) ** (1.0 / 2.2)
