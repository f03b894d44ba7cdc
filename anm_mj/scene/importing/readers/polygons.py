"""Cuts polygons that are not convex: the library cuts every one into a fan about its first corner, which reaches beyond
them, as over a doorway.
"""

from collections.abc import Iterator

import mapbox_earcut
import numpy as np
from jaxtyping import Bool, Float64, Int64

from anm_mj.scene.raster import normals

_BEYOND = 1e-6
"""A triangle of a fan is turned around by more than this share of the polygon where the fan reaches beyond it."""
MAX_CORNERS = 10_000
"""Cutting a polygon takes time that grows with the square of its corners; larger ones stay as they are."""
_TOGETHER = 1_000_000
"""Corners of the polygons that are looked at in one step: each takes some 200 bytes."""


def cut_polygons(
    points: Float64[np.ndarray, "v 3"], corners: Int64[np.ndarray, "n k"]
) -> Iterator[tuple[int, Int64[np.ndarray, "t 3"]]]:
    """The rows of those polygons, of k corners each, that a fan about the first corner does not cover, and for each
    which of its corners, from 0, make its triangles; nothing where a corner is none of the points.
    """
    size = corners.shape[1]
    if not len(corners) or not 3 < size <= MAX_CORNERS or corners.min() < 0 or corners.max() >= len(points):
        return
    step = max(1, _TOGETHER // size)
    for start in range(0, len(corners), step):
        outlines = points[corners[start : start + step]]
        turned = np.cross(outlines, np.roll(outlines, -1, axis=1)).sum(axis=1)
        for row in np.flatnonzero(_exceeded_by_fan(outlines, turned)):
            triangles = _ears(outlines[row], turned[row])
            if len(triangles):
                yield start + int(row), triangles


def _exceeded_by_fan(
    outlines: Float64[np.ndarray, "n k 3"], turned: Float64[np.ndarray, "n 3"]
) -> Bool[np.ndarray, " n"]:
    """Whether a fan about the first corner of a polygon has a triangle that lies the other way round."""
    spokes = outlines[:, 1:] - outlines[:, :1]
    fans = np.cross(spokes[:, :-1], spokes[:, 1:])
    return (np.einsum("nki,ni->nk", fans, turned) < -_BEYOND * np.sum(turned**2, axis=1)[:, None]).any(axis=1)


def _ears(outline: Float64[np.ndarray, "k 3"], turned: Float64[np.ndarray, "3"]) -> Int64[np.ndarray, "t 3"]:
    """Triangles of a polygon by ear clipping in the plane of two axes, turned as its outline; none if it has none."""
    flat = np.delete(outline, int(np.argmax(np.abs(turned))), axis=1)
    found = mapbox_earcut.triangulate_float64(flat, np.array([len(flat)], dtype=np.uint32))
    triangles = found.reshape(-1, 3).astype(np.int64)
    is_back = normals(outline[triangles]) @ turned < 0.0
    triangles[is_back] = triangles[is_back][:, ::-1]
    return triangles
