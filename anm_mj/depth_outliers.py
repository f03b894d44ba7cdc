"""Finds pixels of a depth image that no pixel beside them agrees with: speckles of a faulty depth camera."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32

AGREEMENT = 0.1
"""Two neighbours agree when their depths differ by at most this share of the nearer one."""
LEAST_M = 0.05
"""Or by this [m]."""
MANY_OUTLIERS = 0.002
"""A frame with a larger share of pixels that no neighbour agrees with is not a camera's usual one."""
SUPPORT = 2
"""A pixel that fewer of its eight neighbours agree with is an outlier."""


def outliers(depth_m: Float32[np.ndarray, "h w"], support: int = SUPPORT) -> Bool[np.ndarray, "h w"]:
    """The measured pixels that too few of their neighbours agree with.

    Pixels on the rim of the image have fewer neighbours. A line one pixel wide, such as a far table leg, keeps all its
    pixels but its ends.

    Args:
        depth_m: planar depth [m]; not finite, or not positive, where nothing was measured.
        support: number of neighbours that must agree.
    """
    measured = np.isfinite(depth_m) & (depth_m > 0.0)
    padded = np.pad(np.where(measured, depth_m, np.float32(np.nan)), 1, constant_values=np.nan)
    middle = padded[1:-1, 1:-1]
    agreeing = np.zeros(depth_m.shape, np.uint8)
    rows, cols = depth_m.shape
    limit = np.maximum(np.float32(AGREEMENT) * middle, np.float32(LEAST_M))
    for row in range(3):
        for col in range(3):
            if (row, col) != (1, 1):
                # Comparisons with NaN are false.
                agreeing += np.abs(padded[row : row + rows, col : col + cols] - middle) <= limit
    return measured & (agreeing < support)
