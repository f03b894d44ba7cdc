"""What registrations of late cost and scored: a frame that fits less well than usual may be in a wrong place."""

import math
import statistics

_FRAMES = 20
"""So many frames say what is usual,"""
_RECENT = 3
"""and so many what frames score just now: where much is new, less than usual."""


class FitHistory:
    """Of the last frames that fitted."""

    def __init__(self) -> None:
        """Before any frame."""
        self.costs: list[float] = []
        """A point's, in squared standard deviations."""
        self._scores: list[float] = []

    def add(self, cost: float, score: float) -> None:
        """Take in a frame that fitted: what a point of it cost, and its score in [0, 1]."""
        self.costs = [*self.costs, cost][-_FRAMES:]
        self._scores = [*self._scores, score][-_FRAMES:]

    @property
    def usual_score(self) -> float:
        """What frames score; NaN before any did."""
        return statistics.median(self._scores) if self._scores else math.nan

    @property
    def recent_score(self) -> float:
        """What the last ones score; NaN before any did."""
        return statistics.median(self._scores[-_RECENT:]) if self._scores else math.nan
