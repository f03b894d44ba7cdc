"""Distance to one triangle, the reference of the native search among many."""

import numpy as np


def triangle_distance_squared(points, triangles):
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


def _dot(a, b):
    return np.einsum("ij,ij->i", a, b)
