"""Replayed pixels, packed into 9 bytes each, and the rays that they stand for."""

import numpy as np
from jaxtyping import Float32, Int64, Shaped, UInt16

from anm_mj import _native
from anm_mj.mapping.rays import RayBatch
from anm_mj.types import Observation

DEPTH_UNIT_M = 2e-4
"""Depth is stored in multiples of this [m]; 16 bits reach 13.1 m."""
NO_DEPTH = 0
_DEPTH_LIMIT = np.iinfo(np.uint16).max
PIXEL = np.dtype([("index", "<u4"), ("rgb", np.uint8, 3), ("depth", "<u2")])
"""A stored pixel: its place in the image, row by row, its colour and its depth in units."""
_OPAQUE = np.dtype([("index", "<u4"), ("rgb", "V3"), ("depth", "<u2")])
"""The same with a colour that is copied as a whole, which NumPy does several times as fast."""


def pack(observation: Observation, pixel: Int64[np.ndarray, " p"]) -> Shaped[np.ndarray, " p"]:
    """Some pixels of an observation, of type :data:`PIXEL`."""
    packed = np.empty(len(pixel), _OPAQUE)
    packed["index"] = pixel
    packed["rgb"] = np.ascontiguousarray(observation.rgb).reshape(-1, 3).view(_OPAQUE["rgb"])[:, 0][pixel]
    packed["depth"] = _pack_depth(observation.depth_m.reshape(-1)[pixel])
    return packed.view(PIXEL)


def _pack_depth(depth_m: Float32[np.ndarray, " p"]) -> UInt16[np.ndarray, " p"]:
    """Depth in storage units; what is missing or beyond their reach becomes "no depth"."""
    units = np.rint(depth_m / DEPTH_UNIT_M)
    # Comparisons with NaN are false.
    return np.where((units >= 0) & (units <= _DEPTH_LIMIT), units, NO_DEPTH).astype(np.uint16)


def ray_batches(
    pixels: Shaped[np.ndarray, " p"],
    cameras: Float32[np.ndarray, "c 17"],
    place: Int64[np.ndarray, "k n"],
    keyframe: Int64[np.ndarray, "k n"],
    current: RayBatch,
) -> RayBatch:
    """World rays of ``k`` batches of stored pixels, batch after batch (``native/pixels.h``).

    Args:
        pixels: All that are stored, of type :data:`PIXEL`.
        cameras: Of all keyframes, as :func:`anm_mj.mapping.rays.camera_row` has them.
        place: Where the pixels of each batch lie.
        keyframe: Which keyframe each was seen in.
        current: Other rays, of which each batch gets an equal share in their order, behind its own.
    """
    others = (
        np.ascontiguousarray(array, np.float32)
        for array in (current.origin_m, current.direction, current.rgb, current.depth_m)
    )
    return RayBatch(*_native.ray_batches(pixels.view(np.uint8), cameras, place, keyframe, DEPTH_UNIT_M, *others))
