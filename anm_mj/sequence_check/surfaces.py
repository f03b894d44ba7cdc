"""What frames show in the axes of their cameras: surfaces, sampled points and steps in depth.

Inverse depth is linear over a plane, so its gradient gives the normal. It is taken once, in pixels; what a camera makes
of it is computed where a point is looked up.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int64

from anm_mj.sequence_check.views import View
from anm_mj.types import Intrinsics

POINTS = 200
"""Points of a frame that are held against another one."""


class Planes(NamedTuple):
    """Surfaces at pixels: planar depth, NaN where there is none; unit normals towards the camera; cosine of normal and
    ray, times the length of the ray at a depth of 1; expected standard deviation of depth.
    """

    depth_m: Float32[np.ndarray, "d n"]
    normal: Float32[np.ndarray, "d n 3"]
    cosine: Float32[np.ndarray, "d n"]
    deviation_m: Float32[np.ndarray, "d n"]


class Images:
    """Views of one size, stacked: what no camera changes."""

    def __init__(self, views: list[View]) -> None:
        """Take gradients and sample points."""
        inverse = np.stack([view.inverse_m for view in views])
        down, right = np.gradient(inverse, axis=(1, 2))
        inverse[~(np.isfinite(down) & np.isfinite(right))] = np.nan
        self.inverse = np.stack((inverse, right, down), axis=-1)
        """Inverse of the stated depth, and its gradient along columns and rows, (v, h, w, 3)."""
        self.grey = np.stack([view.grey for view in views])
        self.steep = np.stack([view.steep for view in views])
        self.noise = np.array([view.noise for view in views], np.float32)
        self.points = _padded([_sampled(np.isfinite(one)) for one in inverse])
        """Rows and columns of sampled points, (v, n, 2); -1 where a view has none."""
        last = np.array(inverse.shape[1:]) - 1
        self.rim = _padded([np.minimum(view.rim, last) for view in views])
        """Rows and columns of steps in depth, (v, e, 2); -1 where a view has none."""
        self.rim_inverse = np.full(self.rim.shape[:2], np.nan, np.float32)
        for at, view in enumerate(views):
            self.rim_inverse[at, : len(view.rim)] = view.rim_inverse_m


@dataclass(frozen=True)
class Surfaces:
    """Images as surfaces in the camera's axes, for one camera and one kind of depth."""

    images: Images
    camera: Intrinsics
    ray_depth: bool
    """Whether depth is stated as the distance along the ray."""
    points_m: Float32[np.ndarray, "v n 3"]
    """Sampled points; NaN where the view has none."""
    grey: Float32[np.ndarray, "v n"]
    """Their grey values."""
    rim_m: Float32[np.ndarray, "v e 3"]
    """Points on the nearer side of steps in depth; NaN where the view has none."""

    def planes(
        self, frame: Int64[np.ndarray, "d n"], row: Int64[np.ndarray, "d n"], col: Int64[np.ndarray, "d n"]
    ) -> Planes:
        """The surfaces at pixels of frames."""
        k = self.camera
        x, y = _rays(k, row, col)
        inverse, right, down = np.moveaxis(self.images.inverse[frame, row, col], -1, 0)
        across, along = right * np.float32(k.fx), down * np.float32(k.fy)
        if self.ray_depth:
            length = np.sqrt(1.0 + x * x + y * y, dtype=np.float32)
            across = across * length + inverse * x / length
            along = along * length + inverse * y / length
            inverse = inverse * length
        # A plane n p = d has the inverse depth n (x, y, 1) / d.
        normal = np.stack((across, along, inverse - x * across - y * along), axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            scale = np.float32(-1.0) / np.sqrt((normal[..., 0] ** 2 + normal[..., 1] ** 2) + normal[..., 2] ** 2)
            depth = np.float32(1.0) / inverse
        return Planes(depth, normal * scale[..., None], inverse * scale, depth * depth * self.images.noise[frame])


def surfaces(images: Images, camera: Intrinsics, *, ray_depth: bool = False) -> Surfaces:
    """What the views show if this is their camera. ``camera`` is that of the reduced images; ``ray_depth``: depth is
    the distance along the ray.
    """
    frame = np.arange(len(images.points))[:, None]
    row, col = np.moveaxis(images.points, -1, 0)
    known = row >= 0
    inverse = np.where(known, images.inverse[frame, row, col, 0], np.float32(np.nan))
    return Surfaces(
        images,
        camera,
        ray_depth,
        _points(camera, images.points, inverse, ray_depth=ray_depth),
        np.where(known, images.grey[frame, row, col], np.float32(np.nan)),
        _points(camera, images.rim, images.rim_inverse, ray_depth=ray_depth),
    )


def _points(
    camera: Intrinsics, pixels: Int64[np.ndarray, "v n 2"], inverse: Float32[np.ndarray, "v n"], *, ray_depth: bool
) -> Float32[np.ndarray, "v n 3"]:
    x, y = _rays(camera, *np.moveaxis(pixels, -1, 0))
    z = np.float32(1.0) / inverse
    if ray_depth:
        z = z / np.sqrt(1.0 + x * x + y * y, dtype=np.float32)
    return np.stack((x * z, y * z, z), axis=-1)


def _rays(
    camera: Intrinsics, row: Int64[np.ndarray, "d n"], col: Int64[np.ndarray, "d n"]
) -> tuple[Float32[np.ndarray, "d n"], Float32[np.ndarray, "d n"]]:
    """Where the rays of pixels' middles meet a depth of 1."""
    x = (col.astype(np.float32) + np.float32(0.5 - camera.cx)) / np.float32(camera.fx)
    y = (row.astype(np.float32) + np.float32(0.5 - camera.cy)) / np.float32(camera.fy)
    return x, y


def _sampled(known: Bool[np.ndarray, "h w"]) -> Int64[np.ndarray, "n 2"]:
    """Rows and columns of pixels on a grid over the image, of those that are known."""
    height, width = known.shape
    step = max(1.0, (height * width / POINTS) ** 0.5)
    row = np.arange(step / 2, height, step).astype(np.int64)
    col = np.arange(step / 2, width, step).astype(np.int64)
    pixels = np.stack(np.meshgrid(row, col, indexing="ij"), axis=-1).reshape(-1, 2)
    return pixels[known[pixels[:, 0], pixels[:, 1]]]


def _padded(arrays: list[np.ndarray]) -> Int64[np.ndarray, "v n 2"]:
    """Pixels of different number as one array, with -1 behind the fewer ones."""
    longest = max(1, max(len(one) for one in arrays))
    out = np.full((len(arrays), longest, 2), -1, np.int64)
    for at, one in enumerate(arrays):
        out[at, : len(one)] = one
    return out
