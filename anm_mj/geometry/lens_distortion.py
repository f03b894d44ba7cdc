"""Lens distortion, and images without it: the models of OpenCV and of ROS.

A model says where a direction, given as x / z and y / z in the camera, is imaged, in the same coordinates. Sources: the
section on camera calibration of OpenCV's manual (``plumb_bob``, ``rational_polynomial``, ``thin_prism``); Kannala and
Brandt, A Generic Camera Model and Calibration Method for Conventional, Wide-Angle, and Fish-Eye Lenses, 2006
(``equidistant``).
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int64, UInt8

from anm_mj.types import Intrinsics

EQUIDISTANT = "equidistant"
_NAMES = {
    "plumb_bob": ("k1", "k2", "p1", "p2", "k3"),
    "rational_polynomial": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "thin_prism": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4"),
    EQUIDISTANT: ("k1", "k2", "k3", "k4"),
}
"""Coefficients of each model, in the order of OpenCV."""
_ALIASES = {"fisheye": EQUIDISTANT, "opencv": "plumb_bob", "opencv_fisheye": EQUIDISTANT}
_ONE = 1 << 8
"""Weights of bilinear interpolation add up to this: their products with 8 bits fit into 16."""
_RADII = 1000


@dataclass(frozen=True)
class LensDistortion:
    """A model with its coefficients."""

    model: str
    """``plumb_bob``, ``rational_polynomial``, ``thin_prism`` or ``equidistant``."""
    coefficients: tuple[float, ...]
    """All that the model has, in the order of OpenCV."""
    source: str = "by its files"
    """How they are known, for a line that says so."""

    @classmethod
    def read(cls, words: str) -> LensDistortion | None:
        """What somebody says: coefficients in the order of OpenCV, behind the name of their model or without. Raises
        ValueError as :meth:`of`, or if a word is no number.
        """
        head, *rest = words.split(",")
        named = head.strip()[:1].isalpha() and head.strip().lower() not in ("nan", "inf", "infinity")
        values = [float(word) for word in (rest if named else (head, *rest))]
        if named:
            return cls.of(head.strip(), values, "as given")
        return cls.of("plumb_bob" if len(values) <= 5 else "rational_polynomial", values, "as given")

    @classmethod
    def of(cls, model: str, coefficients: Sequence[float], source: str = "by its files") -> LensDistortion | None:
        """The distortion of a model by name; missing coefficients are 0. None where there is none.

        A fisheye lens has some even where its coefficients are 0: it images angles, not their tangents. Raises
        ValueError if the model is unknown, has fewer coefficients, or one of them is not finite.
        """
        name = _ALIASES.get(model.lower(), model.lower())
        values = tuple(float(value) for value in coefficients)
        if not np.isfinite(values).all():
            raise ValueError(f"the distortion {values} is not finite")
        if name != EQUIDISTANT and not any(values):
            return None
        while values and values[-1] == 0.0:
            values = values[:-1]
        if name not in _NAMES:
            raise ValueError(f"the distortion model '{model}' is none of {', '.join(_NAMES)}")
        if name == "rational_polynomial" and len(values) > len(_NAMES[name]):
            name = "thin_prism"  # ROS has no name of its own for it.
        count = len(_NAMES[name])
        if len(values) > count:
            raise ValueError(f"the distortion model '{model}' has {count} coefficients, not {len(values)}")
        return cls(name, values + (0.0,) * (count - len(values)), source)

    def __str__(self) -> str:
        """The model and its coefficients that are not 0."""
        named = zip(_NAMES[self.model], self.coefficients, strict=True)
        return f"{self.model} " + ", ".join(f"{name} {value:g}" for name, value in named if value)

    def distorted(self, xy: Float[np.ndarray, "... 2"]) -> Float64[np.ndarray, "... 2"]:
        """Where directions x / z, y / z are imaged."""
        x, y = xy[..., 0], xy[..., 1]
        r2 = x * x + y * y
        if self.model == EQUIDISTANT:
            radius = np.sqrt(r2)
            scale = np.divide(self.radius(radius), radius, out=np.ones_like(radius), where=radius > 1e-12)
            return np.stack((x * scale, y * scale), axis=-1)
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = self._polynomial()
        radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        return np.stack(
            (
                x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + r2 * (s1 + r2 * s2),
                y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y + r2 * (s3 + r2 * s4),
            ),
            axis=-1,
        )

    def radius(self, radius: Float[np.ndarray, "..."]) -> Float64[np.ndarray, "..."]:
        """The radial part alone: how far from the centre a direction of radius tan(angle) is imaged."""
        if self.model == EQUIDISTANT:
            angle = np.arctan(radius)
            a2 = angle * angle
            k1, k2, k3, k4 = self.coefficients
            return angle * (1.0 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))
        k1, k2, _, _, k3, k4, k5, k6 = self._polynomial()[:8]
        r2 = np.square(radius)
        return radius * (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))

    def farthest(self, radius: float) -> float:
        """Up to which radius the model is one to one, at most ``radius``: polynomials turn round beyond the image."""
        radii = np.linspace(0.0, radius, _RADII)
        back = np.flatnonzero(np.diff(self.radius(radii)) <= 0.0)
        return float(radii[back[0]]) if len(back) else radius

    def _polynomial(self) -> tuple[float, ...]:
        return self.coefficients + (0.0,) * (12 - len(self.coefficients))


@dataclass(frozen=True)
class Undistortion:
    """Takes the distortion out of images of one camera: what a pinhole camera with the same intrinsics would see."""

    nearest: Int64[np.ndarray, "h w"]
    """Of each pixel, the pixel of the distorted image as a flat index."""
    inside: Bool[np.ndarray, "h w"]
    """Whether the distorted image shows it."""
    corners: Int64[np.ndarray, "4 h w"]
    """The four distorted pixels about it."""
    weights: np.ndarray
    """Of these, 4 x h x w, in 1/256."""

    def depth(self, depth_m: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
        """Depth by the nearest pixel, NaN where the image does not reach; planar depth stays the same along a ray."""
        return np.where(self.inside, depth_m.reshape(-1)[self.nearest], np.float32(np.nan))

    def colour(self, rgb: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
        """Colour, bilinear; black where the image does not reach."""
        flat = rgb.reshape(-1, 3)
        total = np.full(rgb.shape, _ONE // 2, np.uint16)
        for corner, weight in zip(self.corners, self.weights, strict=True):
            total += np.take(flat, corner, axis=0) * weight[..., None]
        return (total >> 8).astype(np.uint8)


@functools.lru_cache(maxsize=2)
def undistortion(
    camera: Intrinsics, distortion: LensDistortion | None, source: Intrinsics | None = None
) -> Undistortion:
    """What takes distortion out of images; made once per camera, which is that of the images that come out. The others'
    distortion may be none, and their camera, ``source``, another one of the same size.
    """
    source = source or camera
    col, row = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    xy = np.stack(((col - camera.cx) / camera.fx, (row - camera.cy) / camera.fy), axis=-1)
    bent = xy if distortion is None else distortion.distorted(xy)
    u, v = bent[..., 0] * source.fx + source.cx - 0.5, bent[..., 1] * source.fy + source.cy - 0.5
    radius = np.hypot(xy[..., 0], xy[..., 1])
    inside = (u > -0.5) & (v > -0.5) & (u < camera.width - 0.5) & (v < camera.height - 0.5)
    if distortion is not None:
        inside &= radius <= distortion.farthest(float(radius.max()))
    u, v = np.where(inside, u, 0.0), np.where(inside, v, 0.0)
    nearest = np.rint(v).astype(np.int64) * camera.width + np.rint(u).astype(np.int64)
    left, top = np.floor(u), np.floor(v)
    right_share, low_share = u - left, v - top
    corners, weights = [], []
    for down, right in np.ndindex(2, 2):
        x = np.clip(left.astype(np.int64) + right, 0, camera.width - 1)
        y = np.clip(top.astype(np.int64) + down, 0, camera.height - 1)
        share = (right_share if right else 1.0 - right_share) * (low_share if down else 1.0 - low_share)
        corners.append(y * camera.width + x)
        weights.append(np.where(inside, np.floor(share * _ONE), 0.0))
    # What rounding left out goes to the nearest pixel: a flat image stays as it is.
    first = np.stack(weights)
    left_out = np.where(inside, _ONE - first.sum(axis=0), 0.0)
    best = np.argmax(first, axis=0)
    np.put_along_axis(first, best[None], np.take_along_axis(first, best[None], axis=0) + left_out, axis=0)
    return Undistortion(nearest, inside, np.stack(corners), first.astype(np.uint16))
