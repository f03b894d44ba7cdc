"""Checks that arrays describe triangles, before anything relies on it."""

from typing import Any

import numpy as np
from jaxtyping import Float32, Int32

FARTHEST_M = 1e6
"""Farther vertices are no building's, and float32 does not tell one centimetre from the next there [m]."""


def checked_triangles(vertices: Any, faces: Any) -> tuple[Float32[np.ndarray, "v 3"], Int32[np.ndarray, "f 3"]]:
    """Vertices [m] and faces as they are meant. Raises ValueError if they have another shape or type, are not finite,
    or a face names a vertex that is not there.
    """
    vertices, faces = np.asarray(vertices), np.asarray(faces)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or vertices.dtype.kind != "f":
        raise ValueError(f"vertices are {vertices.dtype} of shape {vertices.shape}, not floats of shape (v, 3)")
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise ValueError(f"faces are {faces.dtype} of shape {faces.shape}, not integers of shape (f, 3)")
    if not (np.abs(vertices) <= FARTHEST_M).all():
        raise ValueError(f"vertices are not finite, or farther than {FARTHEST_M:g} m")
    if len(faces) and not (faces.min() >= 0 and faces.max() < len(vertices)):
        raise ValueError(f"faces name vertices {faces.min()} to {faces.max()} of {len(vertices)}")
    return vertices.astype(np.float32), faces.astype(np.int32)
