"""Distances of points to a surface of triangles.

The native engine (``native/triangles.h``) compares each point with every triangle that may be the nearest one. Without
it anchor points cover the surface, one on every triangle and about 5 cm apart, and for each point the exact distances
to the triangles of its eight nearest anchors are compared. Where small triangles crowd beside a large one this misses
the nearest.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from anm_mj.ground_truth.ground_truth import sample_triangles
from anm_mj.ground_truth.nearest import spatial_order
from anm_mj.utils.native_functions import native_function
from anm_mj.utils.threads import usual_num_threads

ANCHOR_SPACING_M = 0.05
"""Spacing of anchors [m]."""
NUM_NEAR = 8
"""Anchors per point."""
CHUNK = 20_000
"""Points processed together; bounds the memory to some 50 MiB."""
_ANCHOR_SEED = 0


def surface_distance(
    points: Float[np.ndarray, "n 3"], vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Float[np.ndarray, " n"]:
    """Unsigned distance of points to a triangle mesh [m].

    Args:
        points: world [m].
        vertices: world [m].
        faces: vertex indices; at least one.
    """
    native = native_function("triangle_distances")
    if native is None:
        return anchor_distance(points, vertices, faces)
    order = spatial_order(points)
    found_m = np.empty(len(points))
    corners = np.ascontiguousarray(vertices[faces], dtype=np.float64)
    native(corners, np.ascontiguousarray(points[order], dtype=np.float64), found_m, usual_num_threads())
    distance_m = np.empty(len(points))
    distance_m[order] = found_m
    return distance_m


def anchor_distance(
    points: Float[np.ndarray, "n 3"], vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Float[np.ndarray, " n"]:
    """The same by anchors, see above.

    Raises:
        SceneError: The mesh has no area.
    """
    corners = vertices[faces]
    area_m2 = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    spread, spread_face = sample_triangles(
        vertices, faces, max(1, round(float(area_m2.sum()) / ANCHOR_SPACING_M**2)), _ANCHOR_SEED
    )
    anchors = np.concatenate([corners.mean(axis=1), spread])
    anchor_face = np.concatenate([np.arange(len(faces)), spread_face])
    near = min(NUM_NEAR, len(anchors))
    tree = KDTree(anchors)
    distance_m = np.empty(len(points))
    order = spatial_order(points)
    for start in range(0, len(points), CHUNK):
        chunk = points[order[start : start + CHUNK]]
        _, found = tree.query(chunk, k=near, workers=usual_num_threads())
        candidates = corners[anchor_face[found.reshape(len(chunk), near)]].reshape(-1, 3, 3)
        squared = triangle_distance_squared(np.repeat(chunk, near, axis=0), candidates)
        distance_m[order[start : start + CHUNK]] = np.sqrt(squared.reshape(len(chunk), near).min(axis=1))
    return distance_m


def triangle_distance_squared(
    points: Float[np.ndarray, "n 3"], triangles: Float[np.ndarray, "n 3 3"]
) -> Float[np.ndarray, " n"]:
    """Squared distance of each point to its own triangle [m2]: to the plane if it projects inside, else to an edge."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normal = np.cross(b - a, c - a)
    norm_squared = _dot(normal, normal)
    inside = norm_squared > 0.0
    nearest_edge = np.full(len(points), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge, to_point = end - start, points - start
        inside &= _dot(np.cross(edge, to_point), normal) >= 0.0
        length_squared = _dot(edge, edge)
        along = np.clip(_dot(to_point, edge) / np.where(length_squared > 0.0, length_squared, 1.0), 0.0, 1.0)
        offset = to_point - along[:, None] * edge
        nearest_edge = np.minimum(nearest_edge, _dot(offset, offset))
    to_plane = _dot(points - a, normal) ** 2 / np.where(norm_squared > 0.0, norm_squared, 1.0)
    return np.where(inside, to_plane, nearest_edge)


def _dot(a: Float[np.ndarray, "n 3"], b: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    return np.einsum("ij,ij->i", a, b)
