"""What cameras and their poses must be, in run folders and in recorded sequences alike."""

import math

import numpy as np
from jaxtyping import Bool, Float

from anm_mj.types import Intrinsics

MOST_PX = 16384
"""Larger images are refused [px]."""
FARTHEST_M = 1e6
"""A camera is nowhere beyond this [m]."""
LATEST_S = 4e9
"""No frame is later: the year 2096, and what 32 bits of a bag hold [s]."""
_FOCAL_OF_WIDTH = (0.01, 100.0)
"""Focal lengths between these shares of an image's width are a camera's: from 179 to half a degree."""
_MOST_OFFSET_PX = 1e6
"""A principal point lies nowhere beyond this [px]."""
_NO_ROTATION = 0.05
"""A matrix that differs from its inverse's transpose by more is no rotation."""


def check_camera(camera: Intrinsics) -> None:
    """Raises ValueError for intrinsics that can be those of no camera."""
    if not (1 <= camera.width <= MOST_PX and 1 <= camera.height <= MOST_PX):
        raise ValueError(f"images of {camera.width} x {camera.height} pixels")
    numbers = (camera.fx, camera.fy, camera.cx, camera.cy)
    low, high = (share * camera.width for share in _FOCAL_OF_WIDTH)
    if not (all(low <= f <= high for f in numbers[:2]) and all(abs(c) < _MOST_OFFSET_PX for c in numbers[2:])):
        raise ValueError(
            f"fx, fy, cx, cy = {', '.join(f'{each:g}' for each in numbers)} px, with images of {camera.width} x "
            f"{camera.height} pixels"
        )


def no_poses(matrices: Float[np.ndarray, "n 4 4"]) -> Bool[np.ndarray, " n"]:
    """Which matrices are no pose of a camera: a rotation, a place within ``FARTHEST_M``, and the last row 0 0 0 1."""
    turns = matrices[:, :3, :3]
    with np.errstate(invalid="ignore", over="ignore"):
        good = (np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)) < _NO_ROTATION).all(axis=(1, 2))
        good &= np.einsum("ni,ni->n", turns[:, 0], np.cross(turns[:, 1], turns[:, 2])) > 0.0  # No mirror.
        good &= (np.abs(matrices[:, :3, 3]) <= FARTHEST_M).all(axis=1)
        good &= (np.abs(matrices[:, 3] - [0.0, 0.0, 0.0, 1.0]) < _NO_ROTATION).all(axis=1)
    return np.logical_not(good)


def check_time(time_s: float) -> None:
    """Raises ValueError for a time that no clock shows in seconds."""
    if not (math.isfinite(time_s) and 0.0 <= time_s <= LATEST_S):
        raise ValueError(f"a time of {time_s:g} s")
