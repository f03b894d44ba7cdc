"""How a camera is held above the floor that its depth shows: its height and tilt, without a pose."""

import math

import numpy as np
from jaxtyping import Float, Float32

from anm_mj.frames import rigid_transform

_PLANES = 200
"""Planes through three points each that are tried."""
_NEAR_M = 0.03
"""Points nearer to a plane lie on it [m]."""
_LEAST_SHARE = 0.05
"""Of the points that lie on a floor."""
_MOST_BELOW = 0.02
"""Share of the points that may lie below it, at most."""
_LEAST_COSINE = math.cos(math.radians(60.0))
"""Between the floor's normal and the image's upper edge. A wall ahead looks like the floor below a steeper camera."""
_LEAST_POINTS = 50


def pose_above_floor(points_m: Float32[np.ndarray, "n 3"], rng: np.random.Generator) -> Float[np.ndarray, "4 4"] | None:
    """Height and tilt of a camera, as a pose at x = y = 0 above the floor z = 0; None where it shows no floor.

    The floor is the plane with the most points that lies below nearly all others (RANSAC: Fischler and Bolles, 1981).
    Points are those of a frame, in the camera's axes; ``rng`` draws the planes.
    """
    if len(points_m) < _LEAST_POINTS:
        return None
    points = points_m.astype(np.float64)
    corners = points[rng.integers(len(points), size=(_PLANES, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    kept = length > 1e-6
    normals = normals[kept] / length[kept, None]
    # The camera is above the floor.
    heights = -np.sum(normals * corners[kept, 0], axis=1)
    normals, heights = normals * np.sign(heights)[:, None], np.abs(heights)
    upright = -normals[:, 1] > _LEAST_COSINE
    normals, heights = normals[upright], heights[upright]
    if not len(heights):
        return None
    above = points @ normals.T + heights
    on_it = np.mean(np.abs(above) < _NEAR_M, axis=0)
    on_it[np.mean(above < -_NEAR_M, axis=0) > _MOST_BELOW] = 0.0
    best = int(np.argmax(on_it))
    if on_it[best] < _LEAST_SHARE:
        return None
    floor = points[np.abs(above[:, best]) < _NEAR_M]
    centre = floor.mean(axis=0)
    normal = np.linalg.svd(floor - centre, full_matrices=False)[2][2]
    normal = normal if normal @ normals[best] > 0.0 else -normal
    # World axes in those of the camera; x lies in the floor, where the camera looks.
    x = np.array([0.0, 0.0, 1.0]) - normal[2] * normal
    x /= np.linalg.norm(x)
    rotation = np.stack((x, np.cross(normal, x), normal))
    return rigid_transform(rotation.ravel(), np.array([0.0, 0.0, -float(normal @ centre)]))
