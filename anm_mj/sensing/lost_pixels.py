"""Large squares of a depth image without a measurement, and the ones that looked farther than the sensor's range.

A depth camera loses single pixels at every edge of things. It loses whole squares where a surface is dark or lies at a
grazing angle, and where nothing is within its range; its image does not say which. Things stand on a floor, though:
what is nearer than the floor that is seen below it would hide that floor.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32

BLOCK_PX = 8
"""Pixels are judged in squares of this edge [px]."""
MISSING_SHARE = 0.75
"""At least this share of a square must have measured nothing."""
FAR_SHARE = 0.75
"""What is seen below and above a square that looked too far is at least this share of the range away."""


def lost_squares(depth_m: Float32[np.ndarray, "h w"]) -> Bool[np.ndarray, "rows cols"]:
    """The squares of ``BLOCK_PX`` pixels that measured next to nothing; what is left at the rim is in none.

    Args:
        depth_m: planar depth [m]; NaN where nothing was measured.
    """
    missing = np.isnan(_squares(depth_m))
    if not missing.any():
        return np.zeros((missing.shape[0], missing.shape[2]), bool)
    return missing.mean(axis=(1, 3)) >= MISSING_SHARE


def vouched_depth(depth_m: Float32[np.ndarray, "h w"], range_m: float) -> Float32[np.ndarray, "h w"]:
    """How far each pixel of an image looked through free space.

    A lost square looked as far as the nearest surface that is seen in it, or next in its columns below and above, if
    all of that lies near the end of the range. One with a column without surface below it tells nothing.

    Args:
        depth_m: planar depth [m]; +inf where the sensor says that it looked farther than its range, NaN where it
            measured nothing. The image's columns are vertical.
        range_m: the largest depth that the sensor measures [m].

    Returns:
        Depth [m]: the measured one, ``range_m`` where it was said to be farther, else as above or NaN.
    """
    if not np.isfinite(range_m):
        return depth_m
    vouched = np.where(np.isposinf(depth_m), np.float32(range_m), depth_m)
    lost = lost_squares(depth_m)
    if not lost.any():
        return vouched
    # Unlike min, fmin leaves NaN out, and comparisons with NaN are false.
    below, above = _last_measured(vouched[::-1])[::-1], _last_measured(vouched)
    limit = np.fmin.reduce(_squares(np.fmin(below, above)), axis=(1, 3))
    far = lost & np.isfinite(_squares(below)).all(axis=(1, 3)) & (limit >= FAR_SHARE * range_m)
    squares = _squares(vouched)
    squares[...] = np.where(far[:, None, :, None] & np.isnan(squares), limit[:, None, :, None], squares)
    return vouched


def _squares(image: np.ndarray) -> np.ndarray:
    """A view ``[row of squares, row within, column of squares, column within]``."""
    rows, cols = (n // BLOCK_PX for n in image.shape)
    return image[: rows * BLOCK_PX, : cols * BLOCK_PX].reshape(rows, BLOCK_PX, cols, BLOCK_PX)


def _last_measured(depth_m: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    """For each pixel the last depth of its column down to its own row that is not NaN; NaN where there is none."""
    row = np.where(np.isnan(depth_m), 0, np.arange(len(depth_m))[:, None])
    return np.take_along_axis(depth_m, np.maximum.accumulate(row, axis=0), axis=0)
