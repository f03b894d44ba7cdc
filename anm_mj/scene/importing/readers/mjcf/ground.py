"""Cuts endless and very wide grounds, planes, height fields or flat boxes, to the building that stands on them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from anm_mj.scene.importing.readers.mjcf.shapes import Shape
from anm_mj.scene.raster import clip_to_slab, grid_over, rasterise

_WIDE_M = 20.0
"""A plane or height field wider than this is the ground [m]."""
_FLOOR_RATIO = 3.0
"""One that is not so many times as long as what stands on it is a floor, of a corridor or a hall."""
_OPEN_M = 8.0
"""A world without outer walls gets at least so much ground to each side [m]."""
_ENCLOSED = 0.8
"""A building is enclosed if obstacles stand along this share of its outline."""
_BODY_M = (0.05, 1.4)


def ground_box(
    points_m: Float64[np.ndarray, "n 3"], obstacles_m: Float64[np.ndarray, "f 3 3"]
) -> Float64[np.ndarray, "2 3"]:
    """The box to which grounds are cut: about everything else, or wider where no walls enclose it [m].

    Args:
        points_m: corners of everything that is no ground.
        obstacles_m: triangles that the robot may meet.
    """
    if not len(points_m):
        return np.array([[-_OPEN_M, -_OPEN_M, -_OPEN_M], [_OPEN_M, _OPEN_M, _OPEN_M]]) / 2.0
    low, high = points_m.min(axis=0), points_m.max(axis=0)
    if not _is_enclosed(obstacles_m, low, high):
        middle, half = (low + high) / 2.0, np.maximum((high - low) / 2.0, _OPEN_M / 2.0)
        low[:2], high[:2] = (middle - half)[:2], (middle + half)[:2]
    return np.stack([low, high])


def _is_enclosed(
    obstacles_m: Float64[np.ndarray, "f 3 3"], low: Float64[np.ndarray, "3"], high: Float64[np.ndarray, "3"]
) -> bool:
    """Whether obstacles stand along most of the outline of a box, within its outer twentieth."""
    side_m = float((high - low)[:2].max())
    if not len(obstacles_m) or side_m <= 0.0:
        return False
    cell_m = max(0.1, side_m / 500.0)
    grid = grid_over(np.stack([low, high]), cell_m)
    solid = rasterise(clip_to_slab(obstacles_m, *_BODY_M), grid)
    rim = max(2, round(0.05 * side_m / cell_m))
    sides = [solid[:rim].any(axis=0), solid[-rim:].any(axis=0), solid[:, :rim].any(axis=1), solid[:, -rim:].any(axis=1)]
    # A lone block stands along all of its outline, but has no room within.
    return float(np.concatenate(sides).mean()) >= _ENCLOSED and float(solid.mean()) < 0.5


def cut_plane(
    half_m: Float64[np.ndarray, "2"],
    rotation: Float64[np.ndarray, "3 3"],
    position_m: Float64[np.ndarray, "3"],
    box_m: Float64[np.ndarray, "2 3"],
) -> Shape | None:
    """A plane as a rectangle in its own frame, cut to a box where it is endless or wide; None where nothing is left.

    Args:
        half_m: half its width and depth; 0 for endless [m].
        rotation: of the plane's frame in the world.
        position_m: of the plane in the world.
        box_m: as :func:`ground_box`.
    """
    corners = np.array(np.meshgrid(*box_m.T)).reshape(3, -1).T
    local = (corners - position_m) @ rotation
    low, high = local[:, :2].min(axis=0), local[:, :2].max(axis=0)
    for axis in range(2):
        half = float(half_m[axis])
        if 0.0 < half <= max(_WIDE_M, _FLOOR_RATIO * float(high[axis] - low[axis])) / 2.0:
            low[axis], high[axis] = -half, half
        elif half > 0.0:
            low[axis], high[axis] = max(low[axis], -half), min(high[axis], half)
    if (high <= low).any():
        return None
    vertices = np.array(
        [[low[0], low[1], 0.0], [high[0], low[1], 0.0], [high[0], high[1], 0.0], [low[0], high[1], 0.0]]
    )
    return Shape(vertices, np.array([[0, 1, 2], [0, 2, 3]]), vertices)


def cut_height_field(
    shape: Shape,
    rotation: Float64[np.ndarray, "3 3"],
    position_m: Float64[np.ndarray, "3"],
    box_m: Float64[np.ndarray, "2 3"],
) -> Shape | None:
    """A height field without the triangles that lie wholly beside a box, where it is wide."""
    if float(np.ptp(shape.vertices_m[:, :2], axis=0).max()) <= _WIDE_M:
        return shape
    corners = (shape.vertices_m @ rotation.T + position_m)[shape.faces][:, :, :2]
    beside = (corners.max(axis=1) < box_m[0, :2]) | (corners.min(axis=1) > box_m[1, :2])
    faces = shape.faces[~beside.any(axis=1)]
    return Shape(shape.vertices_m, faces, shape.unit) if len(faces) else None


def is_wide_slab(half_m: Float64[np.ndarray, "3"], rotation: Float64[np.ndarray, "3 3"]) -> bool:
    """Whether a box lies flat and is as wide as a ground.

    Args:
        half_m: half its lengths [m].
        rotation: of its frame in the world.
    """
    upright = int(np.argmax(np.abs(rotation[2])))
    aside = np.delete(half_m, upright)
    return bool(abs(rotation[2, upright]) > 0.999 and aside.max() > _WIDE_M / 2.0 and half_m[upright] < aside.min())


def cut_slab(
    shape: Shape,
    rotation: Float64[np.ndarray, "3 3"],
    position_m: Float64[np.ndarray, "3"],
    box_m: Float64[np.ndarray, "2 3"],
) -> Shape:
    """A box that lies flat, cut to what stands on it where it is a ground; whole where it is a floor or lies aside.

    Args:
        shape: the box; its vertices are its corners.
        rotation: of its frame in the world.
        position_m: of its middle in the world.
        box_m: as :func:`ground_box`.
    """
    corners = np.array(np.meshgrid(*box_m.T)).reshape(3, -1).T
    local = (corners - position_m) @ rotation
    low, high = local.min(axis=0), local.max(axis=0)
    half = shape.vertices_m.max(axis=0)
    upright = int(np.argmax(np.abs(rotation[2])))
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
