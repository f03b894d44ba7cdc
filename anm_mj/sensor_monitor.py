"""Notices a camera that has stopped measuring: one without depth, and one that repeats itself."""

from __future__ import annotations

import logging

import numpy as np

from anm_mj.types import Observation

_logger = logging.getLogger(__name__)

PATIENCE_FRAMES = 12
"""This many faulty frames in a row make a fault."""
FEW_FRAMES = 3
"""One frame without depth may show a wall that is too near; after this many, nothing is known of the surroundings."""


class SensorMonitor:
    """Counts faulty frames in a row."""

    def __init__(self) -> None:
        """Start before the first frame."""
        self._num_blind = 0
        self._num_repeated = 0
        self._has_measured = False
        self._last: Observation | None = None

    @property
    def is_blind(self) -> bool:
        """Whether the camera has measured nothing yet, or nothing in the last few frames."""
        return not self._has_measured or self._num_blind >= FEW_FRAMES

    @property
    def fault(self) -> str | None:
        """What is wrong with the camera, as the beginning of a sentence; None while nothing is."""
        if self._num_blind >= PATIENCE_FRAMES:
            return f"The camera measured no depth in {self._num_blind} frames in a row"
        if self._num_repeated >= PATIENCE_FRAMES:
            return f"The camera gave the same image {self._num_repeated + 1} times although the robot moved"
        return None

    def add(self, observation: Observation, *, moved: bool) -> None:
        """Take a frame in.

        Args:
            observation: the frame.
            moved: whether the robot moved since the last one.
        """
        measured = np.isfinite(observation.depth_m) & (observation.depth_m > 0.0)
        self._num_blind = 0 if measured.any() else self._num_blind + 1
        self._has_measured |= self._num_blind == 0
        if moved and self._last is not None:
            self._num_repeated = self._num_repeated + 1 if _is_same_image(self._last, observation) else 0
        self._last = observation
        if self._num_blind == 1:
            _logger.warning("Frame %d holds no depth.", observation.step)
        if self._num_repeated == 1:
            _logger.warning("Frame %d repeats the last one although the robot moved.", observation.step)


def _is_same_image(a: Observation, b: Observation) -> bool:
    return np.array_equal(a.rgb, b.rgb) and np.array_equal(a.depth_m, b.depth_m, equal_nan=True)
