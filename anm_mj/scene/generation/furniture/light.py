"""Light in the house: what reaches a surface from the lamps, the windows and everywhere else.

The robot's camera sees unlit textures, so that a surface has the same colour from wherever it is seen. Shape shows all
the same, because light and shadow are worked out here once, by casting rays, and painted into the textures.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from anm_mj.utils.raycast import RayCaster

_OFFSET_M = 0.004
"""Rays start this far off their surface, so that they do not hit it."""
_AMBIENT = 0.62
"""Share of an open surface's light that comes from all around."""
_OPENNESS_M = 0.7
"""Distance of a neighbour at which it takes half of the ambient light that would come from its direction."""
_REACH_M = 7.0
"""Lights farther away than this are left out."""
_BATCH = 1_000_000
"""Rays cast at a time, to bound memory."""


@dataclass(frozen=True)
class Light:
    """A rectangle that shines towards its normal."""

    centre_m: tuple[float, float, float]
    half_u_m: tuple[float, float, float]
    half_v_m: tuple[float, float, float]
    normal: tuple[float, float, float]
    power: float
    """Radiance times area, in units in which a white surface 1 m away, face to face, is about fully lit by 1."""


class Lighting:
    """Answers how much light falls on points of a scene's surfaces."""

    def __init__(self, triangles_m: Float64[np.ndarray, "f 3 3"], lights: list[Light], num_rays: int) -> None:
        """Prepare the ray caster.

        Args:
            triangles_m: Everything that throws shadows [m].
            lights: Lamps and windows.
            num_rays: Rays per point for the ambient light; a sixth as many go to every light.

        Raises:
            RayCastError: if embreex is not installed.
        """
        self._rays = RayCaster(triangles_m.reshape(-1, 3), np.arange(3 * len(triangles_m)).reshape(-1, 3))
        self._normals = np.cross(triangles_m[:, 1] - triangles_m[:, 0], triangles_m[:, 2] - triangles_m[:, 0])
        self._lights = lights
        self._num_rays = num_rays

    def falling_on(
        self, points_m: Float64[np.ndarray, "n 3"], normals: Float64[np.ndarray, "n 3"]
    ) -> Float64[np.ndarray, "n 3"]:
        """Light per colour channel; 1 shows a surface in its own colour."""
        total = np.zeros((len(points_m), 3))
        # Chunks of points keep the rays of one chunk in memory only.
        chunk = max(1, _BATCH // self._num_rays)
        for start in range(0, len(points_m), chunk):
            part = slice(start, start + chunk)
            origins = points_m[part] + _OFFSET_M * normals[part]
            total[part] = (_AMBIENT * self._ambient(origins, normals[part], start))[:, None]
            for light in self._lights:
                total[part] += self._direct(origins, normals[part], light)[:, None]
        return total

    def enclosed(
        self, points_m: Float64[np.ndarray, "n 3"], normals: Float64[np.ndarray, "n 3"]
    ) -> Bool[np.ndarray, " n"]:
        """True where nobody can look: every ray off the surface meets some surface's back."""
        num = 16
        directions = _hemisphere(normals, num, 0).reshape(-1, 3)
        origins = np.repeat(points_m + _OFFSET_M * normals, num, axis=0)
        hit = self._rays.faces_hit(origins.astype(np.float32), directions.astype(np.float32))
        back = (hit < 0) | ((self._normals[hit] * directions).sum(axis=1) > 0.0)
        return back.reshape(-1, num).all(axis=1)

    def _ambient(
        self, origins_m: Float64[np.ndarray, "n 3"], normals: Float64[np.ndarray, "n 3"], first: int
    ) -> Float64[np.ndarray, " n"]:
        """Mean openness over the hemisphere, weighted by the cosine."""
        directions = _hemisphere(normals, self._num_rays, first)
        distance = self._rays.lengths(
            np.repeat(origins_m, self._num_rays, axis=0).astype(np.float32),
            directions.reshape(-1, 3).astype(np.float32),
        ).reshape(len(origins_m), -1)
        return (distance / (distance + _OPENNESS_M)).mean(axis=1, dtype=np.float64)

    def _direct(
        self, origins_m: Float64[np.ndarray, "n 3"], normals: Float64[np.ndarray, "n 3"], light: Light
    ) -> Float64[np.ndarray, " n"]:
        """Light from one source, with soft shadows."""
        received = np.zeros(len(origins_m))
        to_centre = np.array(light.centre_m) - origins_m
        near = np.flatnonzero(np.linalg.norm(to_centre, axis=1) < _REACH_M)
        num = max(4, self._num_rays // 6)
        for k in range(num):
            # A Halton-like pair spreads few samples evenly over the rectangle.
            a, b = 2.0 * ((k + 0.5) / num) - 1.0, 2.0 * ((0.5 + k * 0.618034) % 1.0) - 1.0
            source = np.array(light.centre_m) + a * np.array(light.half_u_m) + b * np.array(light.half_v_m)
            ray = source - origins_m[near]
            distance = np.linalg.norm(ray, axis=1)
            ray /= distance[:, None]
            weight = np.clip((ray * normals[near]).sum(axis=1), 0.0, None) * np.clip(
                -ray @ np.array(light.normal), 0.0, None
            )
            lit = weight > 1e-4
            hit = self._rays.lengths(origins_m[near][lit].astype(np.float32), ray[lit].astype(np.float32))
            seen = hit > distance[lit] - 0.03
            # The half metre squared keeps surfaces right beside a lamp from burning out.
            share = light.power * weight[lit] / (distance[lit] ** 2 + 0.25) / num
            received[near[lit]] += np.where(seen, share, 0.0)
        return received


def _hemisphere(normals: Float64[np.ndarray, "n 3"], num: int, first: int) -> Float64[np.ndarray, "n k 3"]:
    """Unit vectors spread over hemispheres by the cosine law; point ``first + i`` turns them its own way."""
    k = np.arange(num)
    radius = np.sqrt((k + 0.5) / num)
    # A golden-angle spiral on the disc, lifted to the sphere.
    angle = k[None, :] * 2.399963 + (first + np.arange(len(normals)))[:, None] * 1.7
    helper = np.where(np.abs(normals[:, 2:]) < 0.9, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    tangent = np.cross(helper, normals)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    bitangent = np.cross(normals, tangent)
    return (
        (radius * np.cos(angle))[..., None] * tangent[:, None]
        + (radius * np.sin(angle))[..., None] * bitangent[:, None]
        + np.sqrt(1.0 - radius**2)[None, :, None] * normals[:, None]
    )


def ceiling_light(x_m: float, y_m: float, z_m: float, power: float) -> Light:
    """The light of a lamp below the ceiling."""
    return Light((x_m, y_m, z_m), (0.18, 0.0, 0.0), (0.0, 0.18, 0.0), (0.0, 0.0, -1.0), power)


def window_light(
    centre_m: tuple[float, float, float], along: tuple[float, float], width_m: float, height_m: float, power: float
) -> Light:
    """The daylight of a window; ``along`` runs along its wall so that the room lies to the right of it."""
    u = (along[0] * width_m / 2, along[1] * width_m / 2, 0.0)
    return Light(centre_m, u, (0.0, 0.0, height_m / 2), (along[1], -along[0], 0.0), power)


def to_linear(srgb: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    """Light intensity of sRGB values in 0..1 (by the plain power law, near enough for paint)."""
    return srgb**2.2


def to_srgb(linear: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    """SRGB values in 0..1 of light intensities; what is brighter than white is eased towards it."""
    soft = np.where(linear < 0.8, linear, 0.8 + 0.2 * np.tanh((linear - 0.8) / 0.2 * 0.8))
    return np.clip(soft, 0.0, 1.0) ** (1.0 / 2.2)
