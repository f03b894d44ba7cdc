"""Where replayed pixels lie: packed, 9 bytes each, in an amount of memory that does not grow."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float32, Int64, Shaped, UInt16

from anm_mj.errors import MapError
from anm_mj.mapping.rays import CAMERA_NUMBERS, RayBatch, concatenate, part, rays_of_pixels
from anm_mj.types import Observation
from anm_mj.utils.native_functions import native_function

DEPTH_UNIT_M = 2e-4
"""Depth is stored in multiples of this [m]; 16 bits reach 13.1 m."""
NO_DEPTH = 0
_DEPTH_LIMIT = np.iinfo(np.uint16).max
PIXEL = np.dtype([("index", "<u4"), ("rgb", np.uint8, 3), ("depth", "<u2")])
"""A stored pixel: its place in the image, row by row, its colour and its depth in units."""
_OPAQUE = np.dtype([("index", "<u4"), ("rgb", "V3"), ("depth", "<u2")])
"""The same with a colour that is copied as a whole, which NumPy does several times as fast."""
_WHOLE = np.dtype(("V", PIXEL.itemsize))
"""The same as bytes that are copied as a whole."""


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


def require_room(pixels: Shaped[np.ndarray, " p"], cameras: Float32[np.ndarray, "k 17"], count: int) -> None:
    """Say so if stored pixels are of another type, or too many.

    Raises:
        MapError: They are.
    """
    if pixels.dtype != PIXEL or len(pixels) > count or cameras.shape[1:] != (CAMERA_NUMBERS,):
        raise MapError(f"{len(pixels)} stored pixels do not fit a replay store of {count}.")


@runtime_checkable
class PixelMemory(Protocol):
    """Room for packed pixels where an engine wants them, and for the cameras that saw them.

    What is kept and drawn is decided by :class:`anm_mj.mapping.keyframes.KeyframeStore`, on the host, so that from the
    same seed all engines keep and draw the same.
    """

    def __len__(self) -> int:
        """How many pixels there is room for."""
        ...

    def add_keyframe(self, start: int, pixels: Shaped[np.ndarray, " p"], camera: Float32[np.ndarray, "17"]) -> None:
        """Take in a keyframe.

        Args:
            start: Place of its first pixel.
            pixels: As :func:`pack` has them.
            camera: As :func:`anm_mj.mapping.rays.camera_row` has it.
        """
        ...

    def first(self, count: int) -> tuple[Shaped[np.ndarray, " p"], Float32[np.ndarray, "k 17"]]:
        """The first ``count`` pixels, of type :data:`PIXEL`, and the cameras of all keyframes; perhaps views."""
        ...

    def replace(self, pixels: Shaped[np.ndarray, " p"], cameras: Float32[np.ndarray, "k 17"]) -> None:
        """Take over what :meth:`first` gave, in place of everything.

        Raises:
            MapError: There is less room.
        """
        ...

    def move(self, old: int, new: int, count: int) -> None:
        """Move ``count`` pixels from place ``old`` on to ``new``, which is no later; the two may overlap."""
        ...

    def batches(
        self, place: Int64[np.ndarray, "k n"], keyframe: Int64[np.ndarray, "k n"], current: RayBatch
    ) -> Iterator[RayBatch]:
        """World rays of ``k`` batches, to be trained on before the next are asked for.

        Args:
            place: Where the pixels of each batch lie.
            keyframe: Which keyframe each was seen in, counted in the order of adding.
            current: Other rays, of which each batch gets an equal share in their order, behind its own.
        """
        ...


class HostPixels:
    """Implements :class:`PixelMemory` in arrays of the host."""

    def __init__(self, count: int, gather: Callable[..., RayBatch] | None = None) -> None:
        """Make room.

        Args:
            count: For so many pixels.
            gather: Makes rays of stored pixels: :func:`numpy_batches`, or :func:`native_batches`, which gives the same;
                None = the second where it was built.
        """
        self._gather = gather or (numpy_batches if native_function("ray_batches") is None else native_batches)
        # One array for all, so that a batch is one look-up however many frames there are. The system hands out its
        # memory only as it is written to.
        self._pixels = np.empty(count, PIXEL)
        self._cameras = np.zeros((0, CAMERA_NUMBERS), np.float32)

    def __len__(self) -> int:
        return len(self._pixels)

    def add_keyframe(self, start: int, pixels: Shaped[np.ndarray, " p"], camera: Float32[np.ndarray, "17"]) -> None:
        """Take in a keyframe; see the protocol."""
        self._pixels[start : start + len(pixels)].view(_WHOLE)[:] = pixels.view(_WHOLE)
        self._cameras = np.concatenate((self._cameras, camera[None]))

    def first(self, count: int) -> tuple[Shaped[np.ndarray, " p"], Float32[np.ndarray, "k 17"]]:
        """Views of pixels and cameras; see the protocol."""
        return self._pixels[:count], self._cameras

    def replace(self, pixels: Shaped[np.ndarray, " p"], cameras: Float32[np.ndarray, "k 17"]) -> None:
        """Take over pixels and cameras; see the protocol."""
        require_room(pixels, cameras, len(self))
        self._pixels[: len(pixels)] = pixels
        self._cameras = cameras.astype(np.float32)

    def move(self, old: int, new: int, count: int) -> None:
        """Move pixels; see the protocol."""
        self._pixels[new : new + count] = self._pixels[old : old + count]

    def batches(
        self, place: Int64[np.ndarray, "k n"], keyframe: Int64[np.ndarray, "k n"], current: RayBatch
    ) -> Iterator[RayBatch]:
        """World rays of batches; see the protocol."""
        rays = self._gather(self._pixels, self._cameras, place, keyframe, current)
        size = place.shape[1] + len(current) // len(place)
        for k in range(len(place)):
            yield part(rays, k * size, size)


def numpy_batches(
    pixels: Shaped[np.ndarray, " p"],
    cameras: Float32[np.ndarray, "c 17"],
    place: Int64[np.ndarray, "k n"],
    keyframe: Int64[np.ndarray, "k n"],
    current: RayBatch,
) -> RayBatch:
    """The rays of :meth:`PixelMemory.batches`, batch after batch; the reference of the native function."""
    (num_batches, num_stored), num_current = place.shape, len(current) // len(place)
    drawn = pixels[place.ravel()]
    units = drawn["depth"]
    depth_m = np.where(units == NO_DEPTH, np.float32(np.nan), units * np.float32(DEPTH_UNIT_M))
    stored = rays_of_pixels(drawn["index"].astype(np.int64), drawn["rgb"], depth_m, cameras[keyframe.ravel()])
    return concatenate(
        *(
            share
            for k in range(num_batches)
            for share in (part(stored, k * num_stored, num_stored), part(current, k * num_current, num_current))
        )
    )


def native_batches(
    pixels: Shaped[np.ndarray, " p"],
    cameras: Float32[np.ndarray, "c 17"],
    place: Int64[np.ndarray, "k n"],
    keyframe: Int64[np.ndarray, "k n"],
    current: RayBatch,
) -> RayBatch:
    """The same in C++ (``native/pixels.h``), to the last bit."""
    function = native_function("ray_batches")
    assert function is not None  # Who chose it has looked.
    others = (
        np.ascontiguousarray(array, np.float32)
        for array in (current.origin_m, current.direction, current.rgb, current.depth_m)
    )
    return RayBatch(*function(pixels.view(np.uint8), cameras, place, keyframe, DEPTH_UNIT_M, *others))
