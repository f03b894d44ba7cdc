"""The replay store: posed pixels of past frames, within a fixed amount of memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Float32, Int64

from anm_mj.errors import MapError
from anm_mj.mapping.pixel_memory import PIXEL, HostPixels, PixelMemory, pack
from anm_mj.mapping.rays import RayBatch, camera_row, sample_frame
from anm_mj.types import Observation


class KeyframeStore:
    """Keyframes, from which training rays are drawn: a frame uniformly, then one of its pixels.

    Memory is bounded: when ``limit_bytes`` is reached, every keyframe gives up a random half of its pixels, and later
    ones bring as few, so that all places keep being replayed, each at a lower density.
    """

    REBUILT = ("_memory",)

    def __init__(
        self, limit_bytes: int, pixel_share: float, make_memory: Callable[[int], PixelMemory] = HostPixels
    ) -> None:
        """An empty store.

        Args:
            limit_bytes: Memory for pixels [bytes].
            pixel_share: Share of a keyframe's pixels to keep, in (0, 1].
            make_memory: Makes room for so many pixels.
        """
        self._share = pixel_share
        self._memory = make_memory(limit_bytes // PIXEL.itemsize)
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
        """Keep a share of an observation's pixels for replay.

        Args:
            observation: The keyframe; of its pixels there must be one that was measured.
            rng: What the choice of pixels comes from.
            weight: How often pixels are kept, in proportion; none, or several times. None: all equally often, and no
                pixel twice.

        Raises:
            MapError: If not even one pixel of each keyframe fits.
        """
        measured = ~np.isnan(observation.depth_m)
        count = max(1, round(self._share * int(measured.sum())))
        # In random order, so that cutting the tail off is a fair thinning.
        if weight is None:
            pixel = rng.permutation(np.flatnonzero(measured))[:count]
        else:
            pixel = rng.permutation(_drawn(np.where(measured, weight, np.float32(0.0)), count, rng))
        while self._start[-1] + count > len(self._memory) and count > 1:
            self._thin()
            count = max(1, count // 2)
        begin = int(self._start[-1])
        if begin + count > len(self._memory):
            raise MapError(f"{len(self)} keyframes of one pixel fill the replay store; raise schedule.replay_bytes.")
        self._memory.add_keyframe(begin, pack(observation, pixel[:count]), camera_row(observation))
        self._start = np.append(self._start, begin + count)

    def checkpoint_state(self) -> tuple[np.ndarray, np.ndarray]:
        """Pixels and cameras, for a checkpoint."""
        return self._memory.first(int(self._start[-1]))

    def restore_state(self, state: tuple[np.ndarray, np.ndarray]) -> None:
        """Take over what :meth:`checkpoint_state` gave."""
        self._memory.replace(*state)

    def _thin(self) -> None:
        """Give up half of every keyframe's pixels, now and in those to come."""
        self._share /= 2.0
        kept = np.maximum(1, self.num_pixels // 2)
        start = np.concatenate((np.zeros(1, np.int64), np.cumsum(kept)))
        # Forwards, each to a place before its own, so that nothing is overwritten before it has moved.
        for old, new, count in zip(self._start[:-1].tolist(), start[:-1].tolist(), kept.tolist(), strict=True):
            self._memory.move(old, new, count)
        self._start = start

    def batches(
        self, count: int, num_stored: int, observation: Observation, num_current: int, rng: np.random.Generator
    ) -> Iterator[RayBatch]:
        """Draw the rays of ``count`` training steps in one go, because its price hardly depends on their number.

        Args:
            count: How many batches.
            num_stored: Pixels of each, every one from a keyframe drawn uniformly.
            observation: The frame at hand.
            num_current: Pixels of each from the frame at hand, behind the others.
            rng: What is drawn by.
        """
        keyframe = rng.integers(len(self), size=count * num_stored)
        position = rng.random(count * num_stored)
        place = self._start[keyframe] + (position * self.num_pixels[keyframe]).astype(np.int64)
        current = sample_frame(observation, count * num_current, rng)
        shape = (count, num_stored)
        return self._memory.batches(place.reshape(shape), keyframe.reshape(shape), current)


def _drawn(weight: Float32[np.ndarray, "h w"], count: int, rng: np.random.Generator) -> Int64[np.ndarray, " count"]:
    """So many pixels, each as often as its share of all weight says, up or down to a whole number."""
    ends = np.cumsum(weight, dtype=np.float64)
    ends = np.floor(ends * (count / ends[-1]) + rng.random()).astype(np.int64)
    ends[-1] = count
    return np.repeat(np.arange(weight.size), np.diff(ends, prepend=0))
