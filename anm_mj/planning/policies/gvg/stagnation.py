"""Detects stagnation: a window of steps in which next to no new surface was seen."""

from __future__ import annotations

import numpy as np

from anm_mj.planning.policies.gvg.config import GvgConfig


class StagnationDetector:
    """Keeps the surface seen at each decision."""

    def __init__(self, config: GvgConfig) -> None:
        """Start before the first decision.

        Args:
            config: length of the window and least useful gain.
        """
        self._config = config
        self._step: list[int] = []
        self._seen_m2: list[float] = []

    def update(self, step: int, seen_m2: float) -> None:
        """Record the surface seen up to a step [m2]; steps must not decrease."""
        self._step.append(step)
        self._seen_m2.append(seen_m2)

    def is_stagnating(self) -> bool:
        """Whether the window up to the last step showed next to no new surface."""
        config = self._config
        begin = self._step[-1] - max(config.stagnation_share * self._step[-1], config.min_stagnation_steps)
        before = int(np.searchsorted(self._step, begin, side="right")) - 1
        if before < 0:
            return False
        return self._seen_m2[-1] - self._seen_m2[before] < config.useful_share * self._seen_m2[-1]
