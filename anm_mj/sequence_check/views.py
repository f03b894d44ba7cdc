"""Frames of a sequence, reduced to what the check compares: inverse depth and grey values.

Inverse depth is linear over a plane, whatever the camera, so its mean over a block of pixels is that of the surface in
the block's middle.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int64
from scipy.ndimage import maximum_filter

from anm_mj.types import Intrinsics, Observation

WIDTH_PX = 160
"""Images are reduced to about this width."""
RIM = 200
"""About so many pixels at steps in depth are looked at."""
_STEP = 0.15
"""Between two pixels with one in between, inverse depth changes by this share at a step."""
_EDGE = 0.15
"""A block whose inverse depths spread by a larger share holds the edge of something."""
_BEND = 0.03
"""Second differences of a larger share of inverse depth are edges too, beyond what noise explains."""


@dataclass(frozen=True)
class View:
    """One reduced frame: the inverse of its stated depth [1/m], NaN where nothing was measured or at an edge; grey
    values in [0, 1], and how much they change at and beside a pixel, as its rank among all pixels in [0, 1]; rows and
    columns of the nearer side of steps in depth, with the inverse depth there [1/m]; the standard deviation of inverse
    depth [1/m].
    """

    index: int
    time_s: float
    inverse_m: Float32[np.ndarray, "h w"]
    grey: Float32[np.ndarray, "h w"]
    steep: Float32[np.ndarray, "h w"]
    rim: Int64[np.ndarray, "e 2"]
    rim_inverse_m: Float32[np.ndarray, " e"]
    noise: float


def reduced_view(index: int, observation: Observation) -> View:
    """A frame, reduced by blocks."""
    block = max(1, round(observation.intrinsics.width / WIDTH_PX))
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.float32(1.0) / observation.depth_m
    inverse = np.where(np.isfinite(inverse) & (inverse > 0.0), inverse, np.float32(np.nan))
    rim, rim_inverse = _rim(inverse[block // 2 :: block, block // 2 :: block])
    rgb = observation.rgb
    grey = (rgb[..., 0].astype(np.float32) + rgb[..., 1] + rgb[..., 2]) / np.float32(3 * 255)
    if block > 1:
        parts = _parts(inverse, block)
        measured = np.isfinite(parts)
        count = measured.sum(axis=0)
        mean = np.where(measured, parts, 0.0).sum(axis=0) / np.maximum(count, 1)
        spread = np.where(measured, np.abs(parts - mean), 0.0).max(axis=0)
        inverse = np.where((count * 2 > block * block) & (spread < _EDGE * mean), mean, np.float32(np.nan))
        grey = _parts(grey, block).mean(axis=0)
    bend = np.concatenate([_bends(inverse, axis).ravel() for axis in (0, 1)])
    bend = bend[np.isfinite(bend)]
    # Second differences of independent errors of deviation s have a variance of 6 s^2.
    noise = float(np.median(bend)) / (0.6745 * 6.0**0.5) if len(bend) > 16 else 0.0
    clean = inverse.copy()
    for axis in (0, 1):
        inner = np.moveaxis(clean, axis, 0)[1:-1]
        limit = np.maximum(_BEND * inner, 10.0 * noise)
        inner[~(np.moveaxis(_bends(inverse, axis), axis, 0) < limit)] = np.nan
    clean, shade = clean.astype(np.float32), grey.astype(np.float32)
    return View(index, observation.time_s, clean, shade, _steep(grey), rim, rim_inverse, noise)


def reduced_camera(camera: Intrinsics) -> Intrinsics:
    """The camera of reduced images."""
    block = max(1, round(camera.width / WIDTH_PX))
    numbers = (value / block for value in (camera.fx, camera.fy, camera.cx, camera.cy))
    return Intrinsics(camera.width // block, camera.height // block, *numbers)


def _rim(inverse_m: Float32[np.ndarray, "h w"]) -> tuple[Int64[np.ndarray, "e 2"], Float32[np.ndarray, " e"]]:
    """The nearer side of steps in depth, one of so many that ``RIM`` are left, and its inverse depth."""
    nearer = np.zeros(inverse_m.shape, bool)
    for axis in (0, 1):
        one, other = np.moveaxis(inverse_m, axis, 0)[:-2], np.moveaxis(inverse_m, axis, 0)[2:]
        at = np.moveaxis(nearer, axis, 0)
        with np.errstate(invalid="ignore"):
            at[:-2] |= one > other * (1.0 + _STEP)
            at[2:] |= other > one * (1.0 + _STEP)
    found = np.argwhere(nearer)
    found = found[:: max(1, len(found) // RIM)]
    return found, inverse_m[found[:, 0], found[:, 1]]


def _steep(grey: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    """Ranks of the grey values' gradient, the largest of a pixel and its neighbours."""
    down, right = np.gradient(grey)
    slope = maximum_filter(np.hypot(down, right), 3)
    rank = np.empty(slope.size, np.float32)
    rank[np.argsort(slope, axis=None, kind="stable")] = np.linspace(0.0, 1.0, slope.size, dtype=np.float32)
    return rank.reshape(slope.shape)


def _parts(image: Float32[np.ndarray, "h w"], block: int) -> Float32[np.ndarray, "b r c"]:
    """The pixels of each block of ``block`` x ``block``, along the first axis."""
    rows, cols = image.shape[0] // block, image.shape[1] // block
    cut = image[: rows * block, : cols * block]
    return np.stack([cut[i::block, j::block] for i in range(block) for j in range(block)])


def _bends(image: Float32[np.ndarray, "h w"], axis: int) -> np.ndarray:
    """Sizes of second differences along an axis."""
    lines = np.moveaxis(image, axis, 0)
    return np.moveaxis(np.abs(lines[2:] - 2.0 * lines[1:-1] + lines[:-2]), 0, axis)
