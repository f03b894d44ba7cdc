"""Rays to train on: what a camera saw along them, in the world, and the depths that are sampled evenly on them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Integer, UInt8

from anm_mj.mapping.mapping_config import SamplingConfig
from anm_mj.sensing.pixel_state import valid_pixels
from anm_mj.types import Observation

CAMERA_NUMBERS = 17
"""Length of a camera's row."""


@dataclass(frozen=True)
class RayBatch:
    """Rays with what the camera saw along them; direction is scaled to planar depth 1, so depth times it is a point."""

    origin_m: Float32[np.ndarray, "n 3"]
    direction: Float32[np.ndarray, "n 3"]
    rgb: Float32[np.ndarray, "n 3"]
    """In [0, 1]."""
    depth_m: Float32[np.ndarray, " n"]
    """Planar depth [m]; NaN where there is none."""

    def __len__(self) -> int:
        return len(self.depth_m)


def part(rays: RayBatch, start: int, count: int) -> RayBatch:
    """So many rays of a batch from one on; views, not copies."""
    rows = slice(start, start + count)
    return RayBatch(*(array[rows] for array in vars(rays).values()))


def sample_frame(observation: Observation, count: int, rng: np.random.Generator) -> RayBatch:
    """Draw ``count`` pixels of one observation among those that were measured, of which there must be one."""
    valid = valid_pixels(observation)
    if valid.all():
        pixel = rng.integers(valid.size, size=count)
    else:
        measured = np.flatnonzero(valid)
        pixel = measured[rng.integers(len(measured), size=count)]
    depth_m = observation.depth_m.reshape(-1)[pixel]
    return rays_of_pixels(
        pixel,
        observation.rgb.reshape(-1, 3)[pixel],
        np.where(np.isfinite(depth_m), depth_m, np.float32(np.nan)),
        np.broadcast_to(camera_row(observation), (count, CAMERA_NUMBERS)),
    )


def camera_row(observation: Observation) -> Float32[np.ndarray, "17"]:
    """What makes world rays of pixels: width, focal lengths, principal point [px]; three rows of T_world_camera [m]."""
    k = observation.intrinsics
    pose = observation.T_world_camera[:3].ravel()
    return np.concatenate(((k.width, k.fx, k.fy, k.cx, k.cy), pose)).astype(np.float32)


def rays_of_pixels(
    pixel: Integer[np.ndarray, " n"],
    rgb: UInt8[np.ndarray, "n 3"],
    depth_m: Float32[np.ndarray, " n"],
    camera: Float32[np.ndarray, "n 17"],
) -> RayBatch:
    """World rays through the middles of pixels. ``pixel`` is the place in the image, row by row; planar depth [m] is
    NaN where there is none; ``camera`` is as :func:`camera_row` has it.
    """
    width, fx, fy, cx, cy = camera.T[:5]
    T_world_camera = camera[:, 5:].reshape(-1, 3, 4)
    row, col = np.divmod(pixel, width.astype(np.int64))
    ahead = np.stack(((col + np.float32(0.5) - cx) / fx, (row + np.float32(0.5) - cy) / fy, np.ones_like(fx)), axis=1)
    direction = np.einsum("nij,nj->ni", T_world_camera[:, :, :3], ahead.astype(np.float32))
    return RayBatch(
        np.ascontiguousarray(T_world_camera[:, :, 3]),
        direction.astype(np.float32),
        rgb.astype(np.float32) / np.float32(255.0),
        depth_m,
    )


def spaced_depths(
    config: SamplingConfig, truncation_m: float
) -> tuple[Float32[np.ndarray, " free"], Float32[np.ndarray, " near"], Float32[np.ndarray, " near"]]:
    """What the uniform sampling scheme is made of [m], the very same numbers for every engine.

    Depths over [0, reach], offsets over the band, and depths where there is no surface to make a band about.
    """
    return (
        _evenly(0.0, config.reach_m, config.free_samples),
        _evenly(-truncation_m, truncation_m, config.near_samples),
        _evenly(0.0, config.reach_m, config.near_samples),
    )


def _evenly(first: float, last: float, count: int) -> Float32[np.ndarray, " count"]:
    """Numbers from first to last, each half counted from its own end so that both ends are exact; as torch has them."""
    low, high = np.float32(first), np.float32(last)
    step = float((high - low) / np.float32(max(count - 1, 1)))
    k = np.arange(count)
    # Products and sums in double precision, rounded once.
    return np.where(k < count // 2, float(low) + step * k, float(high) - step * (count - 1 - k)).astype(np.float32)
