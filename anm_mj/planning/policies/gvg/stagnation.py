"""Whether anything useful has come to light lately: what is left in a lull is crumbs, each a way from the others."""

from __future__ import annotations

import numpy as np

from anm_mj.planning.policies.gvg.config import GvgConfig

USEFUL_SHARE = 0.0025
"""Less new surface than this share of all that was seen is of no use any more."""
LEAST_STEPS = 50
"""A lull lasts at least so many steps: a way across a room shows nothing new either."""


class Progress:
    """The surface seen at each decision."""

    def __init__(self, config: GvgConfig):
        """Start before the first decision.

        Args:
            config: how long a lull is.
        """
        self._share = config.stagnation_share
        self._step: list[int] = []
        self._seen_m2: list[float] = []

    def note(self, step: int, seen_m2: float) -> None:
        """Take in how much has been seen by a step, at least as late as the one before [m2]."""
        self._step.append(step)
        self._seen_m2.append(seen_m2)

    def is_lull(self) -> bool:
        """Whether next to nothing came to light over the last share of all steps so far."""
        since = self._step[-1] - max(self._share * self._step[-1], LEAST_STEPS)
        before = int(np.searchsorted(self._step, since, side="right")) - 1
        if before < 0:
            return False
        return self._seen_m2[-1] - self._seen_m2[before] < USEFUL_SHARE * self._seen_m2[-1]
