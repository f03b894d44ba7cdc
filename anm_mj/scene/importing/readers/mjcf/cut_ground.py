"""Cuts endless and very wide grounds, planes, height fields or flat boxes, to the building that stands on them."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64

from anm_mj.scene.importing.readers.mjcf.geom_triangles import Shape, rectangle
from anm_mj.scene.raster import clip_to_slab, distance_cells, grid_over, label_components, rasterise

_WIDE_M = 20.0
"""A plane or height field wider than this is the ground [m]."""
_FLOOR_RATIO = 3.0
"""A plane less than this many times as long as what stands on it is the floor of a corridor or a hall."""
_OPEN_M = 8.0
"""Least width of the ground of a world without outer walls [m]."""
_ENCLOSED = 0.8
"""A building is enclosed if obstacles stand along this share of its outline, ..."""
_INSIDE = 0.5
"""... or if this share of its outline's area cannot be reached from outside through gaps narrower than a door."""
_DOOR_M = 1.1
"""Gaps in walls that are no wider count as doors [m]."""
_BODIES_M = ((0.05, 1.4), (1.0, 1.4))
"""Heights above the ground at which walls are looked for; at the upper ones nothing of a plinth is in the way."""
_LEVEL = 0.999
"""Cosine of the angle to the vertical."""

_Box = Float64[np.ndarray, "2 3"]
_Vector = Float64[np.ndarray, "3"]


class Placement(NamedTuple):
    """Where a geom stands in the world."""

    rotation: Float64[np.ndarray, "3 3"]
    position_m: _Vector

    def moved(self, shape: Shape) -> Float64[np.ndarray, "v 3"]:
        """Vertices of a geom's shape in the world [m]."""
        return shape.vertices_m @ self.rotation.T + self.position_m


def ground_box(points_m: Float64[np.ndarray, "n 3"], obstacles_m: Float64[np.ndarray, "f 3 3"]) -> tuple[_Box, bool]:
    """The box to which grounds are cut, and whether walls enclose it: then nothing beside it belongs to the building.

    It is the box about ``points_m``, the corners of everything that is no ground, or a wider one where no walls enclose
    it; ``obstacles_m`` are the triangles that the robot may meet.
    """
    if not len(points_m):
        return np.array([[-_OPEN_M, -_OPEN_M, -_OPEN_M], [_OPEN_M, _OPEN_M, _OPEN_M]]) / 2.0, False
    low, high = points_m.min(axis=0), points_m.max(axis=0)
    enclosed = _is_enclosed(obstacles_m, low, high)
    if not enclosed:
        middle, half = (low + high) / 2.0, np.maximum((high - low) / 2.0, _OPEN_M / 2.0)
        low[:2], high[:2] = (middle - half)[:2], (middle + half)[:2]
    return np.stack([low, high]), enclosed


def _is_enclosed(obstacles_m: Float64[np.ndarray, "f 3 3"], low: _Vector, high: _Vector) -> bool:
    """Whether obstacles stand along most of the outline of a box, within its outer twentieth, or around most of it."""
    side_m = float((high - low)[:2].max())
    if not len(obstacles_m) or side_m <= 0.0:
        return False
    cell_m = max(0.1, side_m / 500.0)
    grid = grid_over(np.stack([low, high]), cell_m)
    # The ground lies at 0, or a world is built at a height of its own.
    grounds = dict.fromkeys((0.0, float(obstacles_m[:, :, 2].min())))
    slabs = [clip_to_slab(obstacles_m, ground + a, ground + b) for ground in grounds for a, b in _BODIES_M]
    return any(_are_walls_around(rasterise(slab, grid), side_m, cell_m) for slab in slabs)


def _are_walls_around(solid: Bool[np.ndarray, "rows cols"], side_m: float, cell_m: float) -> bool:
    """Whether obstacles enclose the room in a grid whose longer side is ``side_m`` long."""
    if not solid.any():
        return False
    rim = max(2, round(0.05 * side_m / cell_m))
    sides = [solid[:rim].any(axis=0), solid[-rim:].any(axis=0), solid[:, :rim].any(axis=1), solid[:, -rim:].any(axis=1)]
    # A lone block stands along all of its outline, but has no room within.
    along = float(np.concatenate(sides).mean()) >= _ENCLOSED
    return (along or _share_inside(solid, cell_m) >= _INSIDE) and float(solid.mean()) < 0.5


def _share_inside(solid: Bool[np.ndarray, "rows cols"], cell_m: float) -> float:
    """Share of a grid that cannot be reached from its rim, gaps of a door closed."""
    half = math.ceil(0.5 * _DOOR_M / cell_m)
    away = distance_cells(~np.pad(solid, 2 * half)) > half
    labels, _ = label_components(away)
    inside = away & (labels != labels[0, 0])
    # The rooms as they are without the margin that closed the doors.
    rooms = distance_cells(~inside) <= half if inside.any() else inside
    return float(rooms.sum()) / solid.size


def cut_plane(half_m: Float64[np.ndarray, "2"], place: Placement, box_m: _Box, is_ground: bool) -> Shape | None:
    """A plane of half width and depth ``half_m`` (0: endless) as a rectangle in its own frame; None if nothing is left.

    It is cut to a box where it is endless or wide, or is the ground, however narrow [m].
    """
    low, high = _in_frame(box_m, place)
    for axis in range(2):
        half = float(half_m[axis])
        if not is_ground and 0.0 < half <= max(_WIDE_M, _FLOOR_RATIO * float(high[axis] - low[axis])) / 2.0:
            low[axis], high[axis] = -half, half
        elif half > 0.0:
            low[axis], high[axis] = max(low[axis], -half), min(high[axis], half)
    return None if (high <= low)[:2].any() else rectangle(low[:2], high[:2])


def _in_frame(box_m: _Box, place: Placement) -> tuple[_Vector, _Vector]:
    """Lower and upper corner of the bounds that a box of the world has in a geom's frame [m]."""
    corners = np.array(np.meshgrid(*box_m.T)).reshape(3, -1).T
    local = (corners - place.position_m) @ place.rotation
    return local.min(axis=0), local.max(axis=0)


def surrounds(half_m: Float64[np.ndarray, "2"], up: float, box_m: _Box) -> bool:
    """Whether a plane has more room beside an enclosed building than in it: the robot would take that for the scene.

    ``half_m`` is half its width and depth, ``up`` the upward part of its normal, ``box_m`` the building, z up [m].
    """
    return up > _LEVEL and 4.0 * float(half_m.prod()) > 2.0 * float(np.ptp(box_m[:, :2], axis=0).prod())


def cut_height_field(shape: Shape, place: Placement, box_m: _Box) -> Shape | None:
    """A height field without its underside, which would be the largest floor; if wide, without what is beside a box."""
    first, second, third = np.moveaxis(shape.vertices_m[shape.faces][:, :, :2], 1, 0)
    across, up = second - first, third - first
    turn = across[:, 0] * up[:, 1] - across[:, 1] * up[:, 0]
    shape = Shape(shape.vertices_m, shape.faces[turn >= 0.0], shape.unit)
    if float(np.ptp(shape.vertices_m[:, :2], axis=0).max()) <= _WIDE_M:
        return shape
    corners = place.moved(shape)[shape.faces][:, :, :2]
    beside = (corners.max(axis=1) < box_m[0, :2]) | (corners.min(axis=1) > box_m[1, :2])
    faces = shape.faces[~beside.any(axis=1)]
    return Shape(shape.vertices_m, faces, shape.unit) if len(faces) else None


def is_wide_slab(half_m: _Vector, rotation: Float64[np.ndarray, "3 3"]) -> bool:
    """Whether a box of half lengths ``half_m`` [m] with a ``rotation`` in the world is as flat and wide as a ground."""
    upright = int(np.argmax(np.abs(rotation[2])))
    aside = np.delete(half_m, upright)
    return bool(abs(rotation[2, upright]) > _LEVEL and aside.max() > _WIDE_M / 2.0 and half_m[upright] < aside.min())


def cut_slab(shape: Shape, place: Placement, box_m: _Box) -> Shape:
    """A box that lies flat, cut to what stands on it where it is a ground; whole where it is a floor or lies aside.

    Its vertices are its corners, ``place`` is that of its middle, and ``box_m`` as of :func:`ground_box`.
    """
    low, high = _in_frame(box_m, place)
    half = shape.vertices_m.max(axis=0)
    upright = int(np.argmin(half))
    cut = half > np.maximum(_WIDE_M, _FLOOR_RATIO * (high - low)) / 2.0
    cut[upright] = False
    low, high = np.where(cut, np.maximum(low, -half), -half), np.where(cut, np.minimum(high, half), half)
    if (high <= low).any():
        return shape
    unit = np.clip(shape.unit, low / half, high / half)
    # Texture coordinates of a face are linear in the two coordinates that change along it.
    return Shape(unit * half, shape.faces, unit, _slid(shape, unit), shape.repeats)


def _slid(shape: Shape, unit: Float64[np.ndarray, "v 3"]) -> Float64[np.ndarray, "v 2"] | None:
    """Texture coordinates of the corners of a box that have moved on its faces."""
    if shape.texcoord is None:
        return None
    after = np.empty_like(shape.texcoord)
    for face in range(0, len(unit), 4):
        corner, uv = shape.unit[face : face + 4], shape.texcoord[face : face + 4]
        across, up = corner[1] - corner[0], corner[3] - corner[0]
        moved = unit[face : face + 4] - corner[0]
        share = np.stack([moved @ across / (across @ across), moved @ up / (up @ up)], axis=1)
        after[face : face + 4] = uv[0] + share @ np.stack([uv[1] - uv[0], uv[3] - uv[0]])
    return after
