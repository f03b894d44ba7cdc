"""Surfaces as quadrilaterals: what all walls and furniture of our own scenes are made of.

Every surface is a list of quads, counter-clockwise as seen from the side it is meant to be seen from. A quad is the
unit that light and texture are baked for (``atlas.py``); a triangle is a quad with two equal corners.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ParamSpec

import numpy as np
from jaxtyping import Float64

Point = tuple[float, float, float]
"""x, y, z [m]."""
_Side = Point | Float64[np.ndarray, "3"]
_Arguments = ParamSpec("_Arguments")


@dataclass(frozen=True)
class Material:
    """How a surface looks."""

    colour: Callable[[Float64[np.ndarray, "n 2"]], Float64[np.ndarray, "n 3"]]
    """sRGB in 0..1 at surface coordinates [m]."""
    texel_m: float = 0.015
    """Size of a texel: as small as the finest thing to be seen in it, and never so small that the scene grows heavy."""
    glows: bool = False
    """Whether it is seen by its own light (window panes, lamp shades): no light or shadow falls on it."""


@dataclass(frozen=True)
class Quads:
    """Quads with material and surface coordinates."""

    corners_m: Float64[np.ndarray, "n 4 3"]
    """Counter-clockwise from the visible side: origin, end of u, far corner, end of v."""
    uv_m: Float64[np.ndarray, "n 4 2"]
    """Surface coordinates of the corners, for the material's pattern."""
    materials: tuple[Material, ...]

    @property
    def normals(self) -> Float64[np.ndarray, "n 3"]:
        """Unit normals towards the visible side; taken from the diagonals, so that two corners may be equal."""
        p = self.corners_m
        normals = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
        return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)

    def placed(self, x_m: float = 0.0, y_m: float = 0.0, yaw_deg: float = 0.0, z_m: float = 0.0) -> Quads:
        """The same, turned counter-clockwise about z and then moved."""
        c, s = math.cos(math.radians(yaw_deg)), math.sin(math.radians(yaw_deg))
        rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return Quads(self.corners_m @ rotation.T + (x_m, y_m, z_m), self.uv_m, self.materials)

    def tilted(self, pitch_deg: float) -> Quads:
        """The same, turned about x: positive lifts what lies towards +y."""
        c, s = math.cos(math.radians(pitch_deg)), math.sin(math.radians(pitch_deg))
        rotation = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
        return Quads(self.corners_m @ rotation.T, self.uv_m, self.materials)


def join(*pieces: Quads) -> Quads:
    """All quads of the pieces, in order."""
    return Quads(
        np.concatenate([piece.corners_m for piece in pieces]),
        np.concatenate([piece.uv_m for piece in pieces]),
        tuple(material for piece in pieces for material in piece.materials),
    )


Parts = Iterator[Quads]


def joined(parts: Callable[_Arguments, Parts]) -> Callable[_Arguments, Quads]:
    """Decorates a generator of parts: the call returns them as one."""

    @functools.wraps(parts)
    def whole(*args: _Arguments.args, **kwargs: _Arguments.kwargs) -> Quads:
        return join(*parts(*args, **kwargs))

    return whole


def quads(corners_m: Float64[np.ndarray, "n 4 3"], uv_m: Float64[np.ndarray, "n 4 2"], material: Material) -> Quads:
    """Quads of one material."""
    return Quads(corners_m, uv_m, (material,) * len(corners_m))


def rectangle(
    origin_m: Point, u_m: _Side, v_m: _Side, material: Material, uv_origin_m: tuple[float, float] = (0.0, 0.0)
) -> Quads:
    """A parallelogram that is seen from the side of ``u x v``."""
    origin, u, v = np.array(origin_m), np.array(u_m), np.array(v_m)
    steps = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    corners = origin + steps[:, :1] * u + steps[:, 1:] * v
    uv = uv_origin_m + steps * (np.linalg.norm(u), np.linalg.norm(v))
    return quads(corners[None], uv[None], material)


def _faces(skip: str) -> Iterator[tuple[int, int, int, int]]:
    """Normal axis, sign, u axis and v axis of the faces of a box."""
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        for sign, name in ((1, "+"), (-1, "-")):
            if name + "xyz"[axis] not in skip.split():
                # (first, second, axis) is right-handed, so exchanging the first two turns the face round.
                yield axis, sign, *((first, second) if sign > 0 else (second, first))


def box(low_m: Point, high_m: Point, material: Material, skip: str = "") -> Quads:
    """An upright box; ``skip`` names faces that nobody can see, such as ``"-z +y"``.

    The pattern's u runs along each face's longer side, as the grain of wood does.
    """
    low, high = np.array(low_m), np.array(high_m)
    corners, uvs = [], []
    for _, sign, u, v in _faces(skip):
        face = np.tile(high if sign > 0 else low, (4, 1))
        face[:, u] = [low[u], high[u], high[u], low[u]]
        face[:, v] = [low[v], low[v], high[v], high[v]]
        corners.append(face)
        uvs.append(face[:, [v, u] if high[v] - low[v] > high[u] - low[u] else [u, v]])
    return quads(np.stack(corners), np.stack(uvs), material)


def lathe(profile_m: list[tuple[float, float]], material: Material, sides: int = 12) -> Quads:
    """A body of revolution about z: ``profile_m`` lists (radius, z) along its outside, from the bottom up.

    Start or end it at radius 0 to close it.
    """
    angles = np.linspace(0.0, math.tau, sides + 1)
    radius, z = np.array(profile_m).T
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    points = np.concatenate(
        [radius[:, None, None] * ring, np.broadcast_to(z[:, None, None], (len(z), sides + 1, 1))], axis=-1
    )
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(radius), np.diff(z)))])
    uv = np.stack(np.broadcast_arrays(angles * radius.max(), along[:, None]), axis=-1)
    return grid_quads(points, uv, material)


def cylinder(radius_m: float, z_low_m: float, z_high_m: float, material: Material, sides: int = 12) -> Quads:
    """An upright cylinder without a bottom."""
    return lathe([(radius_m, z_low_m), (radius_m, z_high_m), (0.0, z_high_m)], material, sides)


def ball(radius_m: float, material: Material, sides: int = 12, squash: float = 1.0) -> Quads:
    """A sphere that touches z = 0 from above, its height multiplied by ``squash``."""
    latitudes = np.linspace(-math.pi / 2, math.pi / 2, max(sides // 2, 4) + 1)
    profile = [(radius_m * math.cos(a), radius_m * squash * (1.0 + math.sin(a))) for a in latitudes]
    return lathe(profile, material, sides)


def strut(start_m: Point, end_m: Point, radius_m: float, material: Material, sides: int = 6) -> Quads:
    """A round bar between two points, with flat ends."""
    start, end = np.array(start_m), np.array(end_m)
    axis = end - start
    length = float(np.linalg.norm(axis))
    w = axis / length
    u = np.cross((0.0, 1.0, 0.0) if abs(w[1]) < 0.9 else (1.0, 0.0, 0.0), w)
    u /= np.linalg.norm(u)
    bar = lathe([(0.0, 0.0), (radius_m, 0.0), (radius_m, length), (0.0, length)], material, sides)
    return Quads(bar.corners_m @ np.stack([u, np.cross(w, u), w]) + start, bar.uv_m, bar.materials)


@joined
def cushion(
    low_m: Point, high_m: Point, radius_m: float, material: Material, skip: str = "", segments: int = 2
) -> Parts:
    """A box with round edges and corners."""
    low, high = np.array(low_m), np.array(high_m)
    centre, inner = (low + high) / 2, (high - low) / 2 - radius_m
    # Along each side of a face: the rounded end at the low edge, a flat middle, the rounded end at the high edge.
    bend = np.linspace(0.0, math.pi / 4, segments + 1)
    slope = np.concatenate([-np.tan(bend[::-1]), np.tan(bend)])
    shift = np.concatenate([-np.ones(segments + 1), np.ones(segments + 1)])
    for axis, sign, u, v in _faces(skip):
        direction = np.zeros((len(slope), len(slope), 3))
        core = np.zeros_like(direction)
        direction[..., axis], core[..., axis] = sign, sign * inner[axis]
        direction[..., u], core[..., u] = slope[None, :], shift[None, :] * inner[u]
        direction[..., v], core[..., v] = slope[:, None], shift[:, None] * inner[v]
        direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
        points = centre + core + radius_m * direction
        yield grid_quads(points, points[..., [u, v]], material)


def grid_quads(
    points_m: Float64[np.ndarray, "rows cols 3"], uv_m: Float64[np.ndarray, "rows cols 2"], material: Material
) -> Quads:
    """The cells of a grid of points, seen from the side of ``cols x rows``."""

    def cells(grid: Float64[np.ndarray, "rows cols k"]) -> Float64[np.ndarray, "n 4 k"]:
        around = (grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1])
        return np.stack(around, axis=2).reshape(-1, 4, grid.shape[-1])

    return quads(cells(points_m), cells(uv_m), material)
