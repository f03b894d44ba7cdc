"""The replay store: posed pixels of past frames, 9 bytes each, within a fixed amount of memory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int64, Shaped, UInt16

from anm_mj import _native
from anm_mj.errors import MapError
from anm_mj.mapping.rays import CAMERA_NUMBERS, RayBatch, camera_row, part, sample_frame
from anm_mj.sensing.pixel_state import valid_pixels
from anm_mj.types import Observation

DEPTH_UNIT_M = 2e-4
"""Depth is stored in multiples of this [m]; 16 bits reach 13.1 m."""
NO_DEPTH = 0
_DEPTH_LIMIT = np.iinfo(np.uint16).max
PIXEL = np.dtype([("index", "<u4"), ("rgb", np.uint8, 3), ("depth", "<u2")])
"""A stored pixel: its place in the image, row by row, its colour and its depth in units."""
_OPAQUE = np.dtype([("index", "<u4"), ("rgb", "V3"), ("depth", "<u2")])
"""The same with a colour that is copied as a whole, which NumPy does several times as fast."""
_MOST_PIXELS = 1 << 26
"""No image has more."""
_WHOLE = np.dtype(("V", PIXEL.itemsize))
"""A pixel that is copied as a whole."""


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
    """World rays of ``k`` batches of stored pixels, batch after batch (``native/pixels.h``). ``place`` says where they
    lie in ``pixels``, of type :data:`PIXEL`, and ``keyframe`` whose of ``cameras``, as
    :func:`anm_mj.mapping.rays.camera_row` has them, saw them. Each batch gets an equal share of the rays of
    ``current``, in their order, behind its own.
    """
    others = (np.ascontiguousarray(array, np.float32) for array in vars(current).values())
    return RayBatch(*_native.ray_batches(pixels.view(np.uint8), cameras, place, keyframe, DEPTH_UNIT_M, *others))


def _drawn(weight: Float32[np.ndarray, "h w"], count: int, rng: np.random.Generator) -> Int64[np.ndarray, " count"]:
    """So many pixels, each as often as its share of all weight says, up or down to a whole number."""
    ends = np.cumsum(weight, dtype=np.float64)
    ends = np.floor(ends * (count / ends[-1]) + rng.random()).astype(np.int64)
    ends[-1] = count
    return np.repeat(np.arange(weight.size), np.diff(ends, prepend=0))


@dataclass(frozen=True)
class Keyframes:
    """Pixels of some keyframes, and the cameras that saw them."""

    pixels: Shaped[np.ndarray, " p"]
    """Of type :data:`PIXEL`, those of each keyframe in random order."""
    num_pixels: Int64[np.ndarray, " k"]
    """Pixels of each keyframe; one at least."""
    cameras: Float32[np.ndarray, "k 17"]
    """As :func:`anm_mj.mapping.rays.camera_row` has them."""

    def __len__(self) -> int:
        return len(self.num_pixels)

    @classmethod
    def of(cls, arrays: dict[str, np.ndarray]) -> Keyframes:
        """The keyframes that :meth:`arrays` described. Raises MapError if they were not described so."""
        try:
            data, count, cameras = arrays["pixels"], arrays["num_pixels"].astype(np.int64), arrays["cameras"]
            pixels = np.ascontiguousarray(data).view(PIXEL).reshape(-1)
            fits = data.dtype == np.uint8 and count.ndim == 1 and count.min(initial=1) > 0
            fits &= cameras.shape == (len(count), CAMERA_NUMBERS) and cameras.dtype == np.float32
            # Sums of numbers that are too large wrap around.
            fits &= count.max(initial=0) <= len(pixels) and int(count.sum()) == len(pixels)
            fits = bool(fits) and bool(np.isfinite(cameras).all()) and bool((cameras[:, :3] >= 1.0).all())
        except (KeyError, ValueError, TypeError, AttributeError) as err:
            raise MapError(f"The stored keyframes cannot be read ({err}); explore again.") from err
        if not fits or (pixels["index"] > _MOST_PIXELS).any() or (cameras[:, 0] > _MOST_PIXELS).any():
            raise MapError("The stored keyframes do not fit each other; explore again.")
        return cls(pixels, count, cameras)

    def arrays(self) -> dict[str, np.ndarray]:
        """Plain arrays, for a file."""
        pixels = np.ascontiguousarray(self.pixels).view(np.uint8).reshape(-1, PIXEL.itemsize)
        return {"pixels": pixels, "num_pixels": self.num_pixels, "cameras": self.cameras}

    def without(self, left_out: Bool[np.ndarray, " p"]) -> Keyframes:
        """The same without some pixels, and without keyframes of which none is left."""
        keyframe = np.repeat(np.arange(len(self)), self.num_pixels)
        count = np.bincount(keyframe[~left_out], minlength=len(self))
        return Keyframes(self.pixels[~left_out], count[count > 0], self.cameras[count > 0])

    def thinned(self, limit_bytes: int) -> Keyframes:
        """As many pixels of each keyframe as fit into so much memory, the same number of each that has as many."""
        left, most = limit_bytes // PIXEL.itemsize, 0
        for rank, count in enumerate(np.sort(self.num_pixels).tolist()):
            most = left // (len(self) - rank)
            if count > most:
                break
            most, left = count, left - count
        kept = np.minimum(self.num_pixels, most)
        start = np.cumsum(self.num_pixels) - self.num_pixels
        # Slices: numbers for every pixel would take several times the memory of the pixels.
        parts = [self.pixels[first : first + count] for first, count in zip(start.tolist(), kept.tolist(), strict=True)]
        pixels = np.concatenate([self.pixels[:0], *parts])
        return Keyframes(pixels, kept[kept > 0], self.cameras[kept > 0])


class KeyframeStore:
    """Keyframes, from which training rays are drawn: a frame uniformly, then one of its pixels.

    Memory is bounded: when ``limit_bytes`` is reached, every keyframe gives up a random half of its pixels, and later
    ones bring as few, so that all places keep being replayed, each at a lower density.
    """

    REBUILT = ("_pixels", "_cameras")

    def __init__(self, limit_bytes: int, pixel_share: float) -> None:
        """An empty store. It keeps ``pixel_share`` of a keyframe's pixels, in (0, 1], in ``limit_bytes`` of memory."""
        self._share = pixel_share
        # One array for all, so that a batch is one look-up however many frames there are. The system hands out its
        # memory only as it is written to.
        self._pixels = np.empty(limit_bytes // PIXEL.itemsize, PIXEL)
        self._cameras = np.zeros((0, CAMERA_NUMBERS), np.float32)
        self._start = np.zeros(1, np.int64)

    def __len__(self) -> int:
        return len(self._start) - 1

    @property
    def num_pixels(self) -> Int64[np.ndarray, " k"]:
        """Pixels kept of each keyframe, oldest first."""
        return np.diff(self._start)

    def add(
        self, observation: Observation, rng: np.random.Generator, weight: Float32[np.ndarray, "h w"] | None = None
    ) -> None:
        """Keep a share of an observation's pixels for replay, of which one must have been measured: in proportion to
        ``weight``, some several times, or, with None, all equally often and none twice. Raises MapError if not even one
        pixel of each keyframe fits.
        """
        measured = valid_pixels(observation)
        count = max(1, round(self._share * int(measured.sum())))
        # In random order, so that cutting the tail off is a fair thinning.
        if weight is None:
            pixel = rng.permutation(np.flatnonzero(measured))[:count]
        else:
            pixel = rng.permutation(_drawn(np.where(measured, weight, np.float32(0.0)), count, rng))
        while self._start[-1] + count > len(self._pixels) and count > 1:
            self._thin()
            count = max(1, count // 2)
        begin = int(self._start[-1])
        end = begin + count
        if end > len(self._pixels):
            raise MapError(f"{len(self)} keyframes of one pixel fill the replay store; raise schedule.replay_bytes.")
        self._pixels[begin:end].view(_WHOLE)[:] = pack(observation, pixel[:count]).view(_WHOLE)
        self._cameras = np.concatenate((self._cameras, camera_row(observation)[None]))
        self._start = np.append(self._start, end)

    def keyframes(self, first: int | None = None) -> Keyframes:
        """The oldest ``first`` keyframes, or all; views."""
        first = len(self) if first is None else first
        return Keyframes(self._pixels[: self._start[first]], self.num_pixels[:first], self._cameras[:first])

    def replace(self, first: int, keyframes: Keyframes) -> None:
        """Put other keyframes in the place of the oldest ``first`` ones. Raises MapError if they do not fit."""
        every = self.keyframes()
        rest = every.pixels[int(self._start[first]) :], self.num_pixels[first:], every.cameras[first:]
        pixels = np.concatenate((keyframes.pixels, rest[0]))
        self._start = np.concatenate((np.zeros(1, np.int64), np.cumsum(np.append(keyframes.num_pixels, rest[1]))))
        self._fill(pixels, np.concatenate((keyframes.cameras, rest[2])))

    def move(self, keyframes: Int64[np.ndarray, " m"], T_world_camera: Float[np.ndarray, "m 4 4"]) -> None:
        """Give some keyframes other poses; their rays are drawn from there."""
        self._cameras = self._cameras.copy()
        self._cameras[keyframes, -12:] = T_world_camera[:, :3].reshape(-1, 12)

    def get_state(self) -> tuple[np.ndarray, np.ndarray]:
        """Pixels and cameras, for a checkpoint."""
        return self._pixels[: self._start[-1]], self._cameras

    def set_state(self, state: tuple[np.ndarray, np.ndarray]) -> None:
        """Take over what :meth:`get_state` gave. Raises MapError if it is something else, or has no place here."""
        pixels, cameras = state
        stored = Keyframes.of(Keyframes(pixels, self.num_pixels, cameras).arrays())
        self._fill(stored.pixels, stored.cameras)

    def _fill(self, pixels: Shaped[np.ndarray, " p"], cameras: Float32[np.ndarray, "k 17"]) -> None:
        if len(pixels) > len(self._pixels):
            raise MapError(f"{len(pixels)} stored pixels are more than the replay store holds, {len(self._pixels)}.")
        self._pixels[: len(pixels)] = pixels
        self._cameras = cameras

    def _thin(self) -> None:
        """Give up half of every keyframe's pixels, now and in those to come."""
        self._share /= 2.0
        kept = np.maximum(1, self.num_pixels // 2)
        start = np.concatenate((np.zeros(1, np.int64), np.cumsum(kept)))
        # Forwards, each to a place before its own, so that nothing is overwritten before it has moved.
        for old, new, count in zip(self._start[:-1].tolist(), start[:-1].tolist(), kept.tolist(), strict=True):
            self._pixels[new : new + count] = self._pixels[old : old + count]
        self._start = start

    def batches(
        self, count: int, num_stored: int, observation: Observation, num_current: int, rng: np.random.Generator
    ) -> list[RayBatch]:
        """Draw the rays of ``count`` training steps in one go, because its price hardly depends on their number: of
        each ``num_stored`` pixels, every one from a keyframe drawn uniformly, and behind them ``num_current`` of the
        frame at hand.
        """
        keyframe = rng.integers(len(self), size=count * num_stored)
        position = rng.random(count * num_stored)
        place = self._start[keyframe] + (position * self.num_pixels[keyframe]).astype(np.int64)
        current = sample_frame(observation, count * num_current, rng)
        shape = (count, num_stored)
        rays = ray_batches(self._pixels, self._cameras, place.reshape(shape), keyframe.reshape(shape), current)
        size = num_stored + num_current
        return [part(rays, k * size, size) for k in range(count)]
