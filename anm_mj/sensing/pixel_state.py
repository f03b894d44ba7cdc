"""What each pixel of a depth image is: measured, out of range, lost, or an outlier. Nothing else judges pixels.

A depth camera loses single pixels at every edge of things. It loses whole blocks where a surface is dark or lies at a
grazing angle, and where nothing is within its range; its image does not say which. Things stand on a floor, though:
what is nearer than the floor that is seen below it would hide that floor.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float32, UInt8

from anm_mj import _native
from anm_mj.types import Observation, PixelState

AGREEMENT = 0.1
"""Two neighbours agree when their depths differ by at most this share of the nearer one."""
LEAST_M = 0.05
"""Or by this [m]."""
SUPPORT = 2
"""A pixel that fewer of its eight neighbours agree with is an outlier."""
BLOCK_PX = 8
"""Edge of a block of pixels [px]."""
MISSING_SHARE = 0.75
"""At least this share of a missing block holds no depth."""
FAR_SHARE = 0.75
"""What is seen below and above a block that looked too far is at least this share of the range away."""


def is_measured(depth_m: Float32[np.ndarray, "*pixels"]) -> Bool[np.ndarray, "*pixels"]:
    """Where planar depth [m] is a distance: finite and positive."""
    return np.isfinite(depth_m) & (depth_m > 0.0)


def judge_pixels(observation: Observation, outliers: Bool[np.ndarray, "h w"] | None = None) -> Observation:
    """The observation with the state of its pixels, and NaN for the depth of those that tell nothing; one that was
    judged before is returned as it is. ``outliers`` are measured pixels that are not to be believed; None = all are.
    """
    if observation.pixel_state is not None:
        return observation
    state, depth_m = _states(observation.depth_m), observation.depth_m
    if outliers is not None:
        state[outliers] = PixelState.OUTLIER
    unknown = state > PixelState.OUT_OF_RANGE
    if unknown.any():
        depth_m = np.where(unknown, np.float32(np.nan), depth_m)
    return replace(observation, depth_m=depth_m, pixel_state=state)


def without_moved(observation: Observation, moved: Bool[np.ndarray, "h w"]) -> Observation:
    """The judged frame with the depth of moved pixels apart from the other."""
    seen = judge_pixels(observation)
    assert seen.pixel_state is not None
    nothing = np.float32(np.nan)
    state = np.where(moved, np.uint8(PixelState.MOVED), seen.pixel_state)
    depth_m, moved_m = np.where(moved, nothing, seen.depth_m), np.where(moved, seen.depth_m, nothing)
    return replace(seen, depth_m=depth_m, pixel_state=state, moved_m=moved_m)


def valid_pixels(observation: Observation) -> Bool[np.ndarray, "h w"]:
    """The pixels that tell something: how far a surface is, or that there is none within the range."""
    return _state_of(observation) <= PixelState.OUT_OF_RANGE


def measured_pixels(observation: Observation) -> Bool[np.ndarray, "h w"]:
    """The pixels whose depth is that of a surface."""
    return _state_of(observation) == PixelState.MEASURED


def moved_pixels(observation: Observation) -> Bool[np.ndarray, "h w"]:
    """The pixels that show what moves, and hide what is behind it."""
    return _state_of(observation) == PixelState.MOVED


def _state_of(observation: Observation) -> UInt8[np.ndarray, "h w"]:
    """What the observation carries, or would."""
    return _states(observation.depth_m) if observation.pixel_state is None else observation.pixel_state


def _states(depth_m: Float32[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
    state = np.full(depth_m.shape, PixelState.LOST, np.uint8)
    state[is_measured(depth_m)] = PixelState.MEASURED
    state[np.isposinf(depth_m)] = PixelState.OUT_OF_RANGE
    return state


def find_outliers(depth_m: Float32[np.ndarray, "h w"], support: int = SUPPORT) -> Bool[np.ndarray, "h w"]:
    """The measured pixels that fewer than ``support`` of their neighbours agree with (``native/outliers.h``).
    ``depth_m`` is planar; where nothing was measured it is not finite, or not positive.

    Pixels on the rim of the image have fewer neighbours. A line one pixel wide, such as a far table leg, keeps all its
    pixels but its ends.
    """
    found = np.empty(depth_m.shape, np.uint8)
    _native.depth_outliers(np.ascontiguousarray(depth_m, np.float32), support, AGREEMENT, LEAST_M, found)
    return found.view(bool)


def missing_blocks(missing: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "rows cols"]:
    """The blocks of ``BLOCK_PX`` pixels that hold next to no depth, by which pixels lack it; what is left at the rim is
    in none.
    """
    blocks = _blocks(missing)
    if not blocks.any():
        return np.zeros((blocks.shape[0], blocks.shape[2]), bool)
    # Rows first, which lie in line.
    columns = blocks.view(np.uint8).sum(axis=1, dtype=np.uint16)
    return columns.sum(axis=2, dtype=np.uint16) >= MISSING_SHARE * BLOCK_PX**2


def free_space_depth(depth_m: Float32[np.ndarray, "h w"], range_m: float) -> Float32[np.ndarray, "h w"]:
    """How far each pixel of an image looked through free space [m]: the measured depth, ``range_m`` where it was said
    to be farther, else as below or NaN.

    A missing block looked as far as the nearest surface that is seen in it, or next in its columns below and above, if
    all of that lies near the end of the range. One with a column without surface below it tells nothing. ``depth_m`` is
    planar: +inf where the sensor says that it looked farther than its range, ``range_m``, NaN where it measured
    nothing. The image's columns are vertical.
    """
    if not np.isfinite(range_m):
        return depth_m
    free_m = np.where(np.isposinf(depth_m), np.float32(range_m), depth_m)
    missing = missing_blocks(np.isnan(depth_m))
    if not missing.any():
        return free_m
    # Unlike min, fmin leaves NaN out, and comparisons with NaN are false.
    below, above = _last_measured(free_m[::-1])[::-1], _last_measured(free_m)
    limit = np.fmin.reduce(_blocks(np.fmin(below, above)), axis=(1, 3))
    far = missing & np.isfinite(_blocks(below)).all(axis=(1, 3)) & (limit >= FAR_SHARE * range_m)
    blocks = _blocks(free_m)
    blocks[...] = np.where(far[:, None, :, None] & np.isnan(blocks), limit[:, None, :, None], blocks)
    return free_m


def _blocks(image: np.ndarray) -> np.ndarray:
    """A view ``[row of blocks, row within, column of blocks, column within]``."""
    rows, cols = (n // BLOCK_PX for n in image.shape)
    return image[: rows * BLOCK_PX, : cols * BLOCK_PX].reshape(rows, BLOCK_PX, cols, BLOCK_PX)


def _last_measured(depth_m: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    """For each pixel the last depth of its column down to its own row that is not NaN; NaN where there is none."""
    row = np.where(np.isnan(depth_m), np.int32(0), np.arange(len(depth_m), dtype=np.int32)[:, None])
    return np.take_along_axis(depth_m, np.maximum.accumulate(row, axis=0, out=row), axis=0)
