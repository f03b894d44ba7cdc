"""Frames of a sequence, reduced to what the check compares: inverse depth, surface normals and grey values.

Inverse depth is linear over a plane, whatever the camera, so its mean over a block of pixels is that of the surface in
the block's middle, and its gradient gives the normal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int64
from scipy.ndimage import maximum_filter

from anm_mj.types import Intrinsics, Observation

WIDTH_PX = 160
"""Images are reduced to about this width."""
POINTS = 200
"""Points of a frame that are held against another one."""
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
    """One reduced frame."""

    index: int
    """Of the frame in the sequence."""
    time_s: float
    inverse_m: Float32[np.ndarray, "h w"]
    """Inverse of the stated depth [1/m]; NaN where nothing was measured, or at an edge."""
    grey: Float32[np.ndarray, "h w"]
    """In [0, 1]."""
    steep: Float32[np.ndarray, "h w"]
    """How much grey values change at and beside a pixel, as its rank among all pixels in [0, 1]."""
    rim: Int64[np.ndarray, "e 2"]
    """Rows and columns of the nearer side of steps in depth."""
    rim_inverse_m: Float32[np.ndarray, " e"]
    """Inverse of the stated depth there [1/m]."""
    noise: float
    """Standard deviation of the inverse depth [1/m]."""


@dataclass(frozen=True)
class Surfaces:
    """Views as surfaces in the camera's axes, for one camera and one kind of depth."""

    camera: Intrinsics
    depth_m: Float32[np.ndarray, "v h w"]
    """Planar; NaN where there is none."""
    normal: Float32[np.ndarray, "v h w 3"]
    """Unit normals, towards the camera."""
    deviation_m: Float32[np.ndarray, "v h w"]
    """Expected standard deviation of depth."""
    points_m: Float32[np.ndarray, "v n 3"]
    """Sampled points; NaN where the view has none."""
    grey: Float32[np.ndarray, "v n"]
    """Their grey values."""
    rim_m: Float32[np.ndarray, "v e 3"]
    """Points on the nearer side of steps in depth; NaN where the view has none."""


def reduced_view(index: int, observation: Observation) -> View:
    """A frame, reduced by blocks."""
    block = max(1, round(observation.intrinsics.width / WIDTH_PX))
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.float32(1.0) / observation.depth_m
    inverse = np.where(np.isfinite(inverse) & (inverse > 0.0), inverse, np.float32(np.nan))
    rim, rim_inverse = _rim(inverse[block // 2 :: block, block // 2 :: block])
    if block > 1:
        blocks = _blocks(inverse, block)
        measured = np.isfinite(blocks)
        count = measured.sum(axis=(1, 3))
        filled = np.where(measured, blocks, 0.0)
        mean = filled.sum(axis=(1, 3)) / np.maximum(count, 1)
        spread = np.where(measured, np.abs(blocks - mean[:, None, :, None]), 0.0).max(axis=(1, 3))
        inverse = np.where((count * 2 > block * block) & (spread < _EDGE * mean), mean, np.float32(np.nan))
    grey = observation.rgb.mean(axis=2, dtype=np.float32) / np.float32(255.0)
    if block > 1:
        grey = _blocks(grey, block).mean(axis=(1, 3))
    bend = np.concatenate([_bends(inverse, axis).ravel() for axis in (0, 1)])
    bend = bend[np.isfinite(bend)]
    # Second differences of independent errors of deviation s have a variance of 6 s^2.
    noise = float(np.median(bend)) / (0.6745 * 6.0**0.5) if len(bend) > 16 else 0.0
    clean = inverse.copy()
    for axis in (0, 1):
        inner = np.moveaxis(clean, axis, 0)[1:-1]
        limit = np.maximum(_BEND * inner, 10.0 * noise)
        inner[~(np.moveaxis(_bends(inverse, axis), axis, 0) < limit)] = np.nan
    return View(
        index,
        observation.time_s,
        clean.astype(np.float32),
        grey.astype(np.float32),
        _steep(grey),
        rim,
        rim_inverse,
        noise,
    )


def reduced_camera(camera: Intrinsics) -> Intrinsics:
    """The camera of reduced images."""
    block = max(1, round(camera.width / WIDTH_PX))
    return Intrinsics(
        camera.width // block,
        camera.height // block,
        camera.fx / block,
        camera.fy / block,
        camera.cx / block,
        camera.cy / block,
    )


def surfaces(views: list[View], camera: Intrinsics, *, ray_depth: bool = False) -> Surfaces:
    """What the views show if this is their camera.

    Args:
        views: Of one size.
        camera: Of the reduced images.
        ray_depth: Whether depth is the distance along the ray.
    """
    inverse = np.stack([view.inverse_m for view in views])
    u = ((np.arange(camera.width, dtype=np.float32) + 0.5 - camera.cx) / camera.fx)[None, :]
    v = ((np.arange(camera.height, dtype=np.float32) + 0.5 - camera.cy) / camera.fy)[:, None]
    if ray_depth:
        inverse = inverse * np.sqrt(1.0 + u * u + v * v, dtype=np.float32)
    dv, du = np.gradient(inverse, axis=(1, 2))
    # A plane n p = d has the inverse depth n (u, v, 1) / d.
    x, y = du * np.float32(camera.fx), dv * np.float32(camera.fy)
    normal = np.stack((x, y, inverse - u * x - v * y), axis=-1)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        normal = -normal / length
        depth = np.float32(1.0) / inverse
    depth[~np.isfinite(normal).all(axis=-1)] = np.nan
    noise = np.array([view.noise for view in views], np.float32)[:, None, None]
    points, grey, rims = [], [], []
    for at, view in enumerate(views):
        rows, cols = _sampled(np.isfinite(depth[at]))
        z = depth[at, rows, cols]
        points.append(np.stack((u[0, cols] * z, v[rows, 0] * z, z), axis=1))
        grey.append(view.grey[rows, cols])
        row, col = np.minimum(view.rim, np.array(depth.shape[1:]) - 1).T
        z = np.float32(1.0) / view.rim_inverse_m
        if ray_depth:
            z = z / np.sqrt(1.0 + u[0, col] ** 2 + v[row, 0] ** 2)
        rims.append(np.stack((u[0, col] * z, v[row, 0] * z, z), axis=1))
    return Surfaces(camera, depth, normal, depth * depth * noise, _padded(points), _padded(grey), _padded(rims))


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


def _blocks(image: np.ndarray, block: int) -> np.ndarray:
    rows, cols = image.shape[0] // block, image.shape[1] // block
    return image[: rows * block, : cols * block].reshape(rows, block, cols, block)


def _bends(image: Float32[np.ndarray, "h w"], axis: int) -> np.ndarray:
    """Sizes of second differences along an axis."""
    lines = np.moveaxis(image, axis, 0)
    return np.moveaxis(np.abs(lines[2:] - 2.0 * lines[1:-1] + lines[:-2]), 0, axis)


def _sampled(known: Bool[np.ndarray, "h w"]) -> tuple[Int64[np.ndarray, " n"], Int64[np.ndarray, " n"]]:
    """Rows and columns of pixels on a grid over the image, of those that are known."""
    height, width = known.shape
    step = max(1.0, (height * width / POINTS) ** 0.5)
    row = np.arange(step / 2, height, step).astype(np.int64)
    col = np.arange(step / 2, width, step).astype(np.int64)
    rows, cols = (axis.ravel() for axis in np.meshgrid(row, col, indexing="ij"))
    kept = known[rows, cols]
    return rows[kept], cols[kept]


def _padded(arrays: list[np.ndarray]) -> Float32[np.ndarray, "v n ..."]:
    """Arrays of different length as one, with NaN behind the shorter ones."""
    longest = max(1, max(len(one) for one in arrays))
    out = np.full((len(arrays), longest, *arrays[0].shape[1:]), np.nan, np.float32)
    for at, one in enumerate(arrays):
        out[at, : len(one)] = one
    return out
