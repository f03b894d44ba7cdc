"""Reduced depth: 128 x 128 pixels in whole millimetres, the resolution of the paper's evaluation.

A run stores the reduced depth and the live evaluation uses it too, so a live run and its folder give the same metrics
to the last digit.

Reduction keeps one pixel of the original for each of the result: row ``floor(i * height / 128)``, columns likewise. The
pixel keeps its own ray. The paper's code takes halved intrinsics instead, which shift every point by half an original
pixel, 2 cm at 5 m; :func:`halved_intrinsics` gives its numbers.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Float32, Int, UInt16

from anm_mj.frames import pixel_directions, transform_points
from anm_mj.types import Intrinsics

EVALUATION_SIDE_PX = 128
"""Rows and columns of reduced depth (paper's protocol); smaller images stay as they are."""
MAX_DEPTH_M = 10.0
"""Range of the paper's sensor [m]; farther points never count, whatever the camera."""


@lru_cache(maxsize=8)
def kept_pixels(size_px: int) -> Int[np.ndarray, " n"]:
    """Indices of the rows (or columns) of an image of ``size_px`` rows that reduction keeps; read-only."""
    kept = min(size_px, EVALUATION_SIDE_PX)
    indices = np.arange(kept) * size_px // kept
    indices.setflags(write=False)
    return indices


def reduce_depth(depth_m: Float32[np.ndarray, "h w"]) -> UInt16[np.ndarray, "rows cols"]:
    """Planar depth in whole millimetres at the reduced resolution; 0 without a hit or beyond 65 m."""
    rows, cols = kept_pixels(depth_m.shape[0]), kept_pixels(depth_m.shape[1])
    # Axis by axis: a quarter of the time of both at once.
    millimetres = np.rint(depth_m.take(rows, axis=0).take(cols, axis=1).astype(np.float64) * 1000.0)
    in_range = (millimetres >= 1.0) & (millimetres <= np.iinfo(np.uint16).max)
    return np.where(in_range, millimetres, 0.0).astype(np.uint16)


@lru_cache(maxsize=4)
def _kept_directions(intrinsics: Intrinsics) -> Float[np.ndarray, "rows cols 3"]:
    rows, cols = kept_pixels(intrinsics.height), kept_pixels(intrinsics.width)
    return pixel_directions(intrinsics)[np.ix_(rows, cols)]


def halved_intrinsics(intrinsics: Intrinsics) -> Intrinsics:
    """The intrinsics with which the paper's code back-projects reduced depth, from those of the original image.

    That code resizes an image by its nearest pixels and divides the intrinsics by the same factor, so a kept pixel, the
    first of its block, gets the ray through the middle of the block. The same points come out of the original image
    with a principal point that lies nearer to its corner by half of what a block has more than one pixel.
    """
    wide, high = (size / len(kept_pixels(size)) for size in (intrinsics.width, intrinsics.height))
    return replace(intrinsics, cx=intrinsics.cx - (wide - 1.0) / 2.0, cy=intrinsics.cy - (high - 1.0) / 2.0)


def back_project_reduced(
    depth_mm: UInt16[np.ndarray, "rows cols"], intrinsics: Intrinsics, T_world_camera: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "n 3"]:
    """World points of a reduced depth image (:func:`reduce_depth` [mm]) within the sensor's range [m].

    The intrinsics are those of the original, unreduced image.
    """
    seen = (depth_mm > 0) & (depth_mm <= MAX_DEPTH_M * 1000.0)
    directions = _kept_directions(intrinsics)
    if seen.all():
        # Indoors most frames have depth everywhere; a mask of all pixels costs as much as their transform.
        points_camera = (directions * (depth_mm / 1000.0)[:, :, None]).reshape(-1, 3)
    else:
        points_camera = directions[seen] * (depth_mm[seen] / 1000.0)[:, None]
    return transform_points(T_world_camera, points_camera)
