"""Which way the walls in a depth image face, far more exactly than any of its pixels tells, and what that says of the
camera's heading.

Over a plane, inverse depth is linear in the pixel. So a plane is fitted to each of many squares of the image, and those
of one wall are added up: the normal of a wall of thousands of pixels comes out to a few hundredths of a degree.
"""

import functools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64

from anm_mj.localisation.se3 import rotation_vector
from anm_mj.sensing.pixel_state import is_measured
from anm_mj.types import Intrinsics

_SQUARE, _PIXELS = 8, 128
"""A plane is fitted to so many by so many pixels of an image thinned to about this many along its longer side."""
_LEAST_MEASURED = 0.7
"""Share of a square's pixels that were measured, at least."""
_LEAST_NOISE_PER_M = 3e-4
"""A simulated camera without noise still shows edges between its pixels [1/m]."""
_ROUGH = 4.0
"""A square whose residuals have a larger variance, in those of the noise, is no plane."""
_STEEP = 0.25
"""Cosine to the vertical of a wall's normal at most, for a square of it,"""
_UPRIGHT = 0.01
"""and for the wall as a whole."""
_BENDS = 0.002
"""Surfaces that deviate from a plane by this share of their distance from the camera are one all the same."""
_CHI_SQUARE = 27.0
"""A square belongs to a wall up to this squared deviation of its plane, in variances of three parameters."""
_FIRST_REACH, _NEAR = 6.0, 16.0
"""While one square stands for the wall, more by the first factor. What is near, by the second, but does not belong to
it may be part of a second wall at a small angle."""
_LEAST_PURE = 0.7
"""Share of the near pixels that belong to the wall, at least."""
_LEAST_SQUARES, _REFITS = 4, 4
_MOST_WALLS = 4


@dataclass(frozen=True)
class WallDirection:
    """A wall's normal."""

    angle_rad: float
    """Counter-clockwise from the first level axis; the sign of the normal is arbitrary."""
    deviation_rad: float
    """Standard deviation, as far as the pixels' noise goes."""


def wall_directions(
    depth_m: Float32[np.ndarray, "h w"],
    intrinsics: Intrinsics,
    R_level_camera: Float64[np.ndarray, "3 3"],
    noise_per_m: float,
) -> list[WallDirection]:
    """Directions of the largest upright planes of an image; none if nothing flat stands upright there.

    Planar depth that is not finite and positive was not measured [m]; ``noise_per_m`` is the standard deviation of
    inverse depth [1/m]. ``R_level_camera`` leads from the camera's axes to those whose third one points up.
    """
    noise = max(noise_per_m, _LEAST_NOISE_PER_M)
    squares = _Squares.of(depth_m, intrinsics)
    normal = squares.plane @ R_level_camera.T
    upright = (squares.variance < _ROUGH * noise**2) & (np.abs(normal[:, 2]) < _STEEP * np.linalg.norm(normal, axis=1))
    squares = squares.at(upright)
    limit = _CHI_SQUARE * noise**2 + squares.count * _BENDS**2 * np.sum(squares.plane**2, axis=1)
    alike = squares.deviations(squares.plane) < _FIRST_REACH * limit
    left = np.ones(len(limit), bool)
    found: list[WallDirection] = []
    for _ in range(_MOST_WALLS):
        weights = left * squares.count
        if np.count_nonzero(left) < _LEAST_SQUARES:
            break
        belongs = near = alike[int(np.argmax(left * (alike @ weights)))] & left
        plane, information = np.zeros(3), np.eye(3)
        for _ in range(_REFITS):
            if np.count_nonzero(belongs) < _LEAST_SQUARES:
                break
            information = np.sum(squares.moments[belongs], axis=0)
            plane = np.linalg.solve(information, np.sum(squares.slopes[belongs], axis=0))
            deviation = squares.deviations(plane[None])[0]
            belongs, near = (deviation < limit) & left, (deviation < _NEAR * limit) & left
        left &= ~near
        is_pure = weights[belongs].sum() > _LEAST_PURE * weights[near].sum()
        x, y, z = (R_level_camera @ plane).tolist()
        if is_pure and np.count_nonzero(belongs) >= _LEAST_SQUARES and abs(z) < _UPRIGHT * math.hypot(x, y):
            turn = np.array([-y, x, 0.0]) @ R_level_camera / (x * x + y * y)
            deviation_rad = noise * math.sqrt(float(turn @ np.linalg.solve(information, turn)))
            found.append(WallDirection(math.atan2(y, x), deviation_rad))
    return found


@dataclass(frozen=True)
class _Squares:
    """Planes ``inverse depth = plane . (x, y, 1)`` of image squares, by the slopes x and y of a pixel's ray."""

    count: Float64[np.ndarray, " n"]
    """Measured pixels."""
    moments: Float64[np.ndarray, "n 3 3"]
    """Sums of (x, y, 1) times itself."""
    slopes: Float64[np.ndarray, "n 3"]
    """Sums of (x, y, 1) times inverse depth."""
    plane: Float64[np.ndarray, "n 3"]
    """In the camera's axes also the normal, of length one over the distance [1/m]."""
    variance: Float64[np.ndarray, " n"]
    """Of the residuals [1/m^2]."""

    @classmethod
    def of(cls, depth_m: Float32[np.ndarray, "h w"], intrinsics: Intrinsics) -> "_Squares":
        """Those of an image that were measured well enough."""
        step = _step(intrinsics)
        depth = depth_m[::step, ::step]
        measured = is_measured(depth)
        inverse = np.where(measured, 1.0 / np.where(measured, depth, np.float32(1.0)), np.float32(0.0))
        rays, products = _rays(intrinsics)
        count = _sums(measured.astype(np.float32))
        moments = _sums(products * measured)
        slopes, square = _sums(rays * inverse), _sums(inverse * inverse)
        kept = count >= _LEAST_MEASURED * _SQUARE**2
        count, moments, slopes = count[kept], moments.T[kept].reshape(-1, 3, 3), slopes.T[kept]
        plane = np.linalg.solve(moments, slopes[..., None])[..., 0] if len(count) else slopes
        rest = square[kept] - np.sum(plane * slopes, axis=1)
        return cls(count, moments, slopes, plane, rest / np.maximum(count - 3.0, 1.0))

    def at(self, kept: Bool[np.ndarray, " n"]) -> "_Squares":
        """Some of them."""
        return _Squares(self.count[kept], self.moments[kept], self.slopes[kept], self.plane[kept], self.variance[kept])

    def deviations(self, planes: Float64[np.ndarray, "m 3"]) -> Float64[np.ndarray, "m n"]:
        """Squared deviation of every square's plane from some planes, summed over its pixels [1/m^2]."""
        moments = self.moments.reshape(-1, 9).T
        products = (planes[:, :, None] * planes[:, None, :]).reshape(-1, 9)
        own = np.sum(self.plane * self.slopes, axis=1)
        return products @ moments - 2.0 * planes @ self.slopes.T + own


def _step(k: Intrinsics) -> int:
    return max(1, round(max(k.width, k.height) / _PIXELS))


@functools.lru_cache(maxsize=4)
def _rays(k: Intrinsics) -> tuple[Float32[np.ndarray, "3 h w"], Float32[np.ndarray, "9 h w"]]:
    """(x, y, 1) of the pixels that are looked at, and its products with itself."""
    step = _step(k)
    x = ((np.arange(0, k.width, step) + 0.5 - k.cx) / k.fx).astype(np.float32)
    y = ((np.arange(0, k.height, step) + 0.5 - k.cy) / k.fy).astype(np.float32)
    rays = np.stack((*np.meshgrid(x, y), np.ones((len(y), len(x)), np.float32)))
    return rays, np.concatenate([rays * each for each in rays])


def _sums(image: Float32[np.ndarray, "*c h w"]) -> Float64[np.ndarray, "*c n"]:
    """Over the squares; what is left over at the right and below is left out."""
    *lead, height, width = image.shape
    rows, cols = height // _SQUARE, width // _SQUARE
    cut = image[..., : rows * _SQUARE, : cols * _SQUARE]
    sums = cut.reshape(*lead, rows, _SQUARE, cols, _SQUARE).sum(axis=(-3, -1), dtype=np.float64)
    return sums.reshape(*lead, rows * cols)


class HeadingSums(NamedTuple):
    """Of a pose's rotation about the vertical."""

    information: float
    """[1/rad^2]"""
    slope: float
    """[1/rad]"""
    cost: float
    """Robust, in squared standard deviations."""


@dataclass(frozen=True)
class Headings:
    """What walls say of a camera's heading."""

    T_world_camera: Float[np.ndarray, "4 4"]
    """The pose that headings are counted from."""
    turns_rad: tuple[float, ...]
    """By how much each wall has the camera turned from there, about the vertical."""
    deviations_rad: tuple[float, ...]
    """Standard deviations of these."""
    kernels: tuple[float, float]
    """Widths of Geman and McClure's kernel at first and at the end of a search [standard deviations]."""

    def sums(self, T_world_camera: Float[np.ndarray, "4 4"], share: float = 1.0) -> HeadingSums:
        """What a pose's heading costs, and which way it costs less, a share in [0, 1] of the way between kernels."""
        first, last = self.kernels
        kernel = first * (last / first) ** share
        turned = turned_rad(self.T_world_camera, T_world_camera)
        information = slope = cost = 0.0
        for turn, deviation in zip(self.turns_rad, self.deviations_rad, strict=True):
            off = (turned - turn) / deviation
            kept = kernel**2 / (kernel**2 + off**2)
            information += (kept / deviation) ** 2
            slope += kept**2 * off / deviation
            cost += kept * off**2
        return HeadingSums(information, slope, cost)


def turned_rad(T_from: Float[np.ndarray, "4 4"], T_to: Float[np.ndarray, "4 4"]) -> float:
    """By how much a pose is turned from another one about the vertical."""
    return float(rotation_vector(T_to[:3, :3] @ T_from[:3, :3].T)[2])
