"""The replay store: posed pixels of past frames, packed, within a fixed amount of memory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, UInt8, UInt16, UInt32

from anm_mj.types import Intrinsics, Observation

_DEPTH_UNIT_M = 2e-4
"""Depth is stored in multiples of this [m]; 16 bits reach 13.1 m."""
_NO_DEPTH = 0
_DEPTH_LIMIT = np.iinfo(np.uint16).max


@dataclass(frozen=True)
class RayBatch:
    """Rays with what the camera saw along them; direction is scaled to planar depth 1, so depth times it is a point."""

    origin_m: Float32[np.ndarray, "n 3"]
    direction: Float32[np.ndarray, "n 3"]
    rgb: Float32[np.ndarray, "n 3"]
    """In [0, 1]."""
    depth_m: Float32[np.ndarray, " n"]
    """Planar depth [m]; NaN where there is none."""


@dataclass
class _Keyframe:
    """Pixels of one frame in random order, so that cutting the tail off is a fair thinning."""

    pixel: UInt16[np.ndarray, " p"] | UInt32[np.ndarray, " p"]
    """Index into the image, row by row."""
    rgb: UInt8[np.ndarray, "p 3"]
    depth: UInt16[np.ndarray, " p"]

    @property
    def num_bytes(self) -> int:
        return self.pixel.nbytes + self.rgb.nbytes + self.depth.nbytes


class KeyframeStore:
    """Keyframes and the frame at hand, from which training rays are drawn uniformly.

    Memory is bounded: when ``limit_bytes`` is reached, every keyframe gives up a random half of its pixels, so that all
    places keep being replayed, each at a lower density.
    """

    def __init__(self, limit_bytes: int, pixel_share: float) -> None:
        self._limit_bytes = limit_bytes
        self._share = pixel_share
        self._frames: list[_Keyframe] = []
        self._intrinsics = np.zeros((0, 5), np.float32)
        self._T_world_camera = np.zeros((0, 4, 4), np.float32)
        self._num_bytes = 0

    def __len__(self) -> int:
        return len(self._frames)

    @property
    def num_bytes(self) -> int:
        """Memory that pixels take [bytes]."""
        return self._num_bytes

    def add(self, observation: Observation, rng: np.random.Generator) -> None:
        """Keep a share of an observation's pixels for replay."""
        size = observation.depth_m.size
        share = self._share
        if self._frames:
            share = min(share, len(self._frames[-1].pixel) / size)
        count = max(1, round(share * size))
        pixel = rng.permutation(size)[:count]
        frame = _Keyframe(
            pixel.astype(np.uint16 if size <= 1 << 16 else np.uint32),
            observation.rgb.reshape(-1, 3)[pixel],
            _pack_depth(observation.depth_m.reshape(-1)[pixel]),
        )
        self._frames.append(frame)
        row = _intrinsics_row(observation.intrinsics)
        self._intrinsics = np.concatenate((self._intrinsics, row[None]))
        pose = observation.T_world_camera.astype(np.float32)
        self._T_world_camera = np.concatenate((self._T_world_camera, pose[None]))
        self._num_bytes += frame.num_bytes
        while self._num_bytes > self._limit_bytes and len(frame.pixel) > 1:
            self._thin()

    def _thin(self) -> None:
        for frame in self._frames:
            keep = max(1, len(frame.pixel) // 2)
            # Copies, because a slice would keep the whole array alive.
            frame.pixel = frame.pixel[:keep].copy()
            frame.rgb = frame.rgb[:keep].copy()
            frame.depth = frame.depth[:keep].copy()
        self._num_bytes = sum(frame.num_bytes for frame in self._frames)

    def sample(self, count: int, rng: np.random.Generator) -> RayBatch:
        """Draw ``count`` pixels, each from a keyframe drawn uniformly."""
        which = rng.integers(len(self._frames), size=count)
        position = rng.random(count)
        pixel = np.empty(count, np.int64)
        rgb = np.empty((count, 3), np.uint8)
        depth = np.empty(count, np.uint16)
        order = np.argsort(which, kind="stable")
        starts = np.flatnonzero(np.diff(which[order], prepend=-1))
        for rows in np.split(order, starts[1:]):
            frame = self._frames[which[rows[0]]]
            chosen = (position[rows] * len(frame.pixel)).astype(np.int64)
            pixel[rows], rgb[rows], depth[rows] = frame.pixel[chosen], frame.rgb[chosen], frame.depth[chosen]
        depth_m = np.where(depth == _NO_DEPTH, np.float32(np.nan), depth * np.float32(_DEPTH_UNIT_M))
        return _rays(pixel, rgb, depth_m, self._intrinsics[which], self._T_world_camera[which])


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
