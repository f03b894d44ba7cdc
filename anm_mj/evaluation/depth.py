"""The depth that counts: 128 x 128 pixels in whole millimetres, as the paper's evaluation reads it.

A run stores this reduced depth and nothing finer, and the live evaluator works on it too, so that numbers computed
while a run goes and numbers computed from its folder are the same to the last digit.

Reduction takes one pixel of the original for each of the result: row ``floor(i * height / 128)`` and column likewise,
which for a 256 x 256 image is every even pixel. Its ray is the true ray of that original pixel. (Halving the
intrinsics, as is often done, would instead shift every point by half an original pixel: 2 cm at 5 m.)
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from jaxtyping import Float, Float32, Int, UInt16

from anm_mj.frames import pixel_directions, transform_points
from anm_mj.types import Intrinsics

EVALUATION_SIDE_PX = 128
"""Rows and columns of an evaluated frame (paper's protocol); smaller images are kept as they are."""
MAX_DEPTH_M = 10.0
"""Range of the paper's sensor [m]; what is farther does not count as seen, whatever the camera."""


def kept_pixels(size_px: int) -> Int[np.ndarray, " n"]:
    """Indices of the rows (or columns) of an image of ``size_px`` rows that reduction keeps."""
    kept = min(size_px, EVALUATION_SIDE_PX)
    return np.arange(kept) * size_px // kept


def reduce_depth(depth_m: Float32[np.ndarray, "h w"]) -> UInt16[np.ndarray, "rows cols"]:
    """Planar depth in whole millimetres at the evaluated resolution; 0 where nothing was hit or beyond 65 m."""
    rows, cols = kept_pixels(depth_m.shape[0]), kept_pixels(depth_m.shape[1])
    millimetres = np.rint(depth_m[np.ix_(rows, cols)].astype(np.float64) * 1000.0)
    in_range = (millimetres >= 1.0) & (millimetres <= np.iinfo(np.uint16).max)
    return np.where(in_range, millimetres, 0.0).astype(np.uint16)


@lru_cache(maxsize=4)
def _kept_directions(intrinsics: Intrinsics) -> Float[np.ndarray, "rows cols 3"]:
    rows, cols = kept_pixels(intrinsics.height), kept_pixels(intrinsics.width)
    return pixel_directions(intrinsics)[np.ix_(rows, cols)]


def back_project_reduced(
    depth_mm: UInt16[np.ndarray, "rows cols"], intrinsics: Intrinsics, T_world_camera: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "n 3"]:
    """World points of a reduced depth image, those beyond the sensor's range left out [m].

    Args:
        depth_mm: What :func:`reduce_depth` made of the image.
        intrinsics: Of the original, unreduced image.
        T_world_camera: Camera to world, CV axes.
    """
    seen = (depth_mm > 0) & (depth_mm <= MAX_DEPTH_M * 1000.0)
    directions = _kept_directions(intrinsics)
    if seen.all():
        # Indoors most frames are whole; picking all pixels one by one costs as much as moving them.
        points_camera = (directions * (depth_mm / 1000.0)[:, :, None]).reshape(-1, 3)
    else:
        points_camera = directions[seen] * (depth_mm[seen] / 1000.0)[:, None]
    return transform_points(T_world_camera, points_camera)
