"""Which pixels of a frame are registered, and how far each is believed."""

import functools
import math
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int64

from anm_mj.mapping.alignment import FramePoints
from anm_mj.protocols import FindsMoved
from anm_mj.types import Intrinsics, Observation

_EDGE_PX = 2
"""Depth is compared with that of pixels so far away on either side."""
_EDGE_SHARE = 0.02
"""A second difference of depth of more than this share of the depth is an edge."""
_EDGE_DEVIATIONS = 4.0
"""And of more than so many standard deviations of the sensor's noise."""


def draw_points(
    observation: Observation, count: int, noise_per_m: float, range_m: float, rng: np.random.Generator
) -> FramePoints:
    """About ``count`` measured pixels, drawn evenly over the image; none at depth edges, or beyond ``range_m``. The
    deviation of the sensor's depth is ``noise_per_m`` times its square [1/m].
    """
    k = observation.intrinsics
    row, col = _spread(k.height, k.width, count, rng)
    depth = observation.depth_m[row, col]
    with np.errstate(invalid="ignore"):
        kept = (depth > 0.0) & (depth <= range_m)
        noise = noise_per_m if math.isfinite(noise_per_m) else 0.0
        limit = np.maximum(_EDGE_SHARE * depth, _EDGE_DEVIATIONS * math.sqrt(6.0) * noise * depth**2)
        kept &= ~_at_edge(observation.depth_m, row, col, depth, limit)
    row, col, depth = row[kept], col[kept], depth[kept]
    x, y = _slopes(k, row, col)
    deviation = noise * depth**2 * np.sqrt(1.0 + x**2 + y**2)
    rgb = observation.rgb[row, col].astype(np.float32) / np.float32(255.0)
    variance = (deviation**2).astype(np.float32)
    return FramePoints(_in_camera(x, y, depth), rgb, variance, np.ones(len(depth), np.float32))


def grid_points(observation: Observation, count: int) -> Float32[np.ndarray, "n 3"]:
    """The measured ones of about ``count`` pixels on a regular grid over the image, in the camera's axes [m]."""
    row, col, x, y = _grid(observation.intrinsics, count)
    depth = observation.depth_m[row, col]
    # Comparisons with NaN are false.
    known = (depth > 0.0) & (depth < np.inf)
    return _in_camera(x[known], y[known], depth[known])


def without_moved(
    observation: Observation,
    mapper: FindsMoved,
    T_world_camera: Float[np.ndarray, "4 4"],
    deviations: tuple[float, float],
) -> Observation:
    """The frame without the pixels that moved, as far as a map tells from where the camera may be: about
    ``T_world_camera``, with the standard deviations of its position [m] and its rotation [rad].
    """
    position_m, rotation_rad = deviations
    believed = replace(observation, T_world_camera=T_world_camera, position_deviation_m=position_m)
    return mapper.find_moved(replace(believed, heading_deviation_rad=rotation_rad))


@functools.lru_cache(maxsize=2)
def _grid(
    k: Intrinsics, count: int
) -> tuple[Int64[np.ndarray, " n"], Int64[np.ndarray, " n"], Float64[np.ndarray, " n"], Float64[np.ndarray, " n"]]:
    """Rows and columns of a regular grid of about ``count`` pixels, and their slopes."""
    step = max(1.0, math.sqrt(k.width * k.height / count))
    rows, cols = (np.arange(step / 2, size, step).astype(np.int64) for size in (k.height, k.width))
    row, col = np.repeat(rows, len(cols)), np.tile(cols, len(rows))
    return row, col, *_slopes(k, row, col)


def _slopes(
    k: Intrinsics, row: Int64[np.ndarray, " n"], col: Int64[np.ndarray, " n"]
) -> tuple[Float64[np.ndarray, " n"], Float64[np.ndarray, " n"]]:
    """Of the rays through pixels, x / z and y / z."""
    x = (col + np.float32(0.5) - np.float32(k.cx)) / np.float32(k.fx)
    y = (row + np.float32(0.5) - np.float32(k.cy)) / np.float32(k.fy)
    return x, y


def _in_camera(
    x: Float64[np.ndarray, " n"], y: Float64[np.ndarray, " n"], depth: Float32[np.ndarray, " n"]
) -> Float32[np.ndarray, "n 3"]:
    return np.stack((x * depth, y * depth, depth), axis=1).astype(np.float32)


def _spread(
    height: int, width: int, count: int, rng: np.random.Generator
) -> tuple[Int64[np.ndarray, " n"], Int64[np.ndarray, " n"]]:
    """Rows and columns of one pixel in each cell of a grid of about ``count`` cells."""
    cell = math.sqrt(height * width / count)
    rows, cols = max(1, round(height / cell)), max(1, round(width / cell))
    place = rng.random((2, rows, cols))
    row = ((np.arange(rows)[:, None] + place[0]) * (height / rows)).astype(np.int64)
    col = ((np.arange(cols)[None, :] + place[1]) * (width / cols)).astype(np.int64)
    return np.minimum(row, height - 1).ravel(), np.minimum(col, width - 1).ravel()


def _at_edge(
    depth_m: Float32[np.ndarray, "h w"],
    row: Int64[np.ndarray, " n"],
    col: Int64[np.ndarray, " n"],
    depth: Float32[np.ndarray, " n"],
    limit: Float32[np.ndarray, " n"],
) -> Bool[np.ndarray, " n"]:
    """Whether depth bends by more than ``limit`` [m] at pixels, or is missing beside them."""
    height, width = depth_m.shape
    up, down = np.maximum(row - _EDGE_PX, 0), np.minimum(row + _EDGE_PX, height - 1)
    left, right = np.maximum(col - _EDGE_PX, 0), np.minimum(col + _EDGE_PX, width - 1)
    bent = np.zeros(len(row), bool)
    for one, other in (((up, col), (down, col)), ((row, left), (row, right))):
        # Not "larger than": where a neighbour was not measured, the comparison with NaN is false.
        bent |= ~(np.abs(depth_m[one] + depth_m[other] - 2.0 * depth) <= limit)
    return bent
