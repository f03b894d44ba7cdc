"""The replay store: posed pixels of past frames, packed, within a fixed amount of memory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int64, UInt16

from anm_mj.errors import MapError
from anm_mj.types import Intrinsics, Observation

_DEPTH_UNIT_M = 2e-4
"""Depth is stored in multiples of this [m]; 16 bits reach 13.1 m."""
_NO_DEPTH = 0
_DEPTH_LIMIT = np.iinfo(np.uint16).max
_PIXEL = np.dtype([("index", np.uint32), ("rgb", np.uint8, 3), ("depth", np.uint16)])
"""A stored pixel, 9 bytes: its place in the image, row by row, its colour and its depth in units."""


@dataclass(frozen=True)
class RayBatch:
    """Rays with what the camera saw along them; direction is scaled to planar depth 1, so depth times it is a point."""

    origin_m: Float32[np.ndarray, "n 3"]
    direction: Float32[np.ndarray, "n 3"]
    rgb: Float32[np.ndarray, "n 3"]
    """In [0, 1]."""
    depth_m: Float32[np.ndarray, " n"]
    """Planar depth [m]; NaN where there is none."""


class KeyframeStore:
    """Keyframes, from which training rays are drawn: a frame uniformly, then one of its pixels.

    Memory is bounded: when ``limit_bytes`` is reached, every keyframe gives up a random half of its pixels, and later
    ones bring as few, so that all places keep being replayed, each at a lower density.
    """

    def __init__(self, limit_bytes: int, pixel_share: float) -> None:
        self._share = pixel_share
        # One array for all, so that a batch is one look-up however many frames there are. The system hands out its
        # memory only as it is written to.
        self._pixels = np.empty(limit_bytes // _PIXEL.itemsize, _PIXEL)
        self._start = np.zeros(1, np.int64)
        self._intrinsics = np.zeros((0, 5), np.float32)
        self._T_world_camera = np.zeros((0, 4, 4), np.float32)

    def __len__(self) -> int:
        return len(self._start) - 1

    @property
    def num_bytes(self) -> int:
        """Memory that pixels take [bytes]."""
        return int(self._start[-1]) * _PIXEL.itemsize

    @property
    def num_pixels(self) -> Int64[np.ndarray, " k"]:
        """Pixels kept of each keyframe, oldest first."""
        return np.diff(self._start)

    def add(self, observation: Observation, rng: np.random.Generator) -> None:
        """Keep a share of an observation's pixels for replay."""
        size = observation.depth_m.size
        count = max(1, round(self._share * size))
        # In random order, so that cutting the tail off is a fair thinning.
        pixel = rng.permutation(size)[:count]
        while self._start[-1] + count > len(self._pixels) and count > 1:
            self._thin()
            count = max(1, count // 2)
        begin, end = self._start[-1], self._start[-1] + count
        if end > len(self._pixels):
            raise MapError(f"{len(self)} keyframes of one pixel fill the replay store; raise schedule.replay_bytes.")
        pixel = pixel[:count]
        new = self._pixels[begin:end]
        new["index"] = pixel
        new["rgb"] = observation.rgb.reshape(-1, 3)[pixel]
        new["depth"] = _pack_depth(observation.depth_m.reshape(-1)[pixel])
        self._start = np.append(self._start, end)
        row = _intrinsics_row(observation.intrinsics)
        self._intrinsics = np.concatenate((self._intrinsics, row[None]))
        pose = observation.T_world_camera.astype(np.float32)
        self._T_world_camera = np.concatenate((self._T_world_camera, pose[None]))

    def _thin(self) -> None:
        """Give up half of every keyframe's pixels, now and in those to come."""
        self._share /= 2.0
        kept = np.maximum(1, self.num_pixels // 2)
        start = np.concatenate((np.zeros(1, np.int64), np.cumsum(kept)))
        # Forwards, each to a place before its own, so that nothing is overwritten before it has moved.
        for old, new, count in zip(self._start[:-1].tolist(), start[:-1].tolist(), kept.tolist(), strict=True):
            self._pixels[new : new + count] = self._pixels[old : old + count]
        self._start = start

    def sample(self, count: int, rng: np.random.Generator) -> RayBatch:
        """Draw ``count`` pixels, each from a keyframe drawn uniformly."""
        which = rng.integers(len(self), size=count)
        position = rng.random(count)
        pixels = self._pixels[self._start[which] + (position * self.num_pixels[which]).astype(np.int64)]
        depth = pixels["depth"]
        depth_m = np.where(depth == _NO_DEPTH, np.float32(np.nan), depth * np.float32(_DEPTH_UNIT_M))
        index = pixels["index"].astype(np.int64)
        return _rays(index, pixels["rgb"], depth_m, self._intrinsics[which], self._T_world_camera[which])


def sample_frame(observation: Observation, count: int, rng: np.random.Generator) -> RayBatch:
    """Draw ``count`` pixels of one observation."""
    pixel = rng.integers(observation.depth_m.size, size=count)
    return _rays(
        pixel,
        observation.rgb.reshape(-1, 3)[pixel],
        observation.depth_m.reshape(-1)[pixel],
        np.broadcast_to(_intrinsics_row(observation.intrinsics), (count, 5)),
        np.broadcast_to(observation.T_world_camera.astype(np.float32), (count, 4, 4)),
    )


def part(rays: RayBatch, start: int, count: int) -> RayBatch:
    """So many rays of a batch from one on; views, not copies."""
    rows = slice(start, start + count)
    return RayBatch(rays.origin_m[rows], rays.direction[rows], rays.rgb[rows], rays.depth_m[rows])


def concatenate(a: RayBatch, b: RayBatch) -> RayBatch:
    """Both batches as one."""
    return RayBatch(
        np.concatenate((a.origin_m, b.origin_m)),
        np.concatenate((a.direction, b.direction)),
        np.concatenate((a.rgb, b.rgb)),
        np.concatenate((a.depth_m, b.depth_m)),
    )


def _intrinsics_row(intrinsics: Intrinsics) -> Float32[np.ndarray, "5"]:
    values = (intrinsics.width, intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy)
    return np.array(values, np.float32)


def _pack_depth(depth_m: Float32[np.ndarray, " p"]) -> UInt16[np.ndarray, " p"]:
    """Depth in storage units; what is missing or beyond their reach becomes "no depth"."""
    units = np.rint(np.nan_to_num(depth_m, nan=0.0, posinf=0.0, neginf=0.0) / _DEPTH_UNIT_M)
    return np.where((units < 0) | (units > _DEPTH_LIMIT), _NO_DEPTH, units).astype(np.uint16)


def _rays(
    pixel: np.ndarray, rgb: np.ndarray, depth_m: np.ndarray, intrinsics: np.ndarray, T_world_camera: np.ndarray
) -> RayBatch:
    width, fx, fy, cx, cy = intrinsics.T
    row, col = np.divmod(pixel, width.astype(np.int64))
    camera = np.stack(((col + np.float32(0.5) - cx) / fx, (row + np.float32(0.5) - cy) / fy, np.ones_like(fx)), axis=1)
    direction = np.einsum("nij,nj->ni", T_world_camera[:, :3, :3], camera.astype(np.float32))
    return RayBatch(
        np.ascontiguousarray(T_world_camera[:, :3, 3]),
        direction.astype(np.float32),
        rgb.astype(np.float32) / np.float32(255.0),
        depth_m.astype(np.float32),
    )
