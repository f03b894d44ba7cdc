"""Finds pixels of a depth image that no pixel beside them agrees with: speckles of a faulty depth camera.

In C++ (``native/outliers.h``) where the native engine was built, else in NumPy; both find the same.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32

from anm_mj.utils.native_functions import native_function

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
    function = native_function("depth_outliers")
    if function is None:
        return numpy_outliers(depth_m, support)
    found = np.empty(depth_m.shape, np.uint8)
    function(np.ascontiguousarray(depth_m, np.float32), support, AGREEMENT, LEAST_M, found)
    return found.view(bool)


def numpy_outliers(depth_m: Float32[np.ndarray, "h w"], support: int) -> Bool[np.ndarray, "h w"]:
    """The reference of :func:`outliers`."""
    measured = np.isfinite(depth_m) & (depth_m > 0.0)
    known = depth_m if measured.all() else np.where(measured, depth_m, np.float32(np.nan))
    limit = np.maximum(np.float32(AGREEMENT) * known, np.float32(LEAST_M))
    # Next to all pixels have neighbours enough in their row, so few are looked at all around. Comparisons with NaN are
    # false.
    step = np.abs(known[:, 1:] - known[:, :-1])
    in_row = np.zeros(depth_m.shape, np.uint8)
    in_row[:, :-1] += step <= limit[:, :-1]
    in_row[:, 1:] += step <= limit[:, 1:]
    unsure = measured & (in_row < support)
    row, col = np.nonzero(unsure)
    if not len(row):
        return unsure
    padded = np.pad(known, 1, constant_values=np.nan)
    agreeing = np.zeros(len(row), np.uint8)
    for down in range(3):
        for along in range(3):
            if (down, along) != (1, 1):
                agreeing += np.abs(padded[row + down, col + along] - known[row, col]) <= limit[row, col]
    unsure[row, col] = agreeing < support
    return unsure
