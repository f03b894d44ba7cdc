"""Cuts endless and very wide grounds to the building that stands on them."""

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
