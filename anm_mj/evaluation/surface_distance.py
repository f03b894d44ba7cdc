"""Distances of points to a surface of triangles (``native/triangles.h``)."""

import numpy as np
from jaxtyping import Float, Int

from anm_mj import _native
from anm_mj.ground_truth.nearest import spatial_order
from anm_mj.utils.threads import usual_num_threads


def surface_distance(
    points: Float[np.ndarray, "n 3"], vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Float[np.ndarray, " n"]:
    """Unsigned distance of points to a triangle mesh [m]. There is one face at least."""
    order = spatial_order(points)
    ordered_m, distance_m = np.empty((2, len(points)))
    corners = np.ascontiguousarray(vertices[faces], dtype=np.float64)
    _native.triangle_distances(
        corners, np.ascontiguousarray(points[order], dtype=np.float64), ordered_m, usual_num_threads()
    )
    distance_m[order] = ordered_m
    return distance_m
