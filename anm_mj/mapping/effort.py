"""How much is trained on a frame, where somebody knows better than the schedule."""

from __future__ import annotations

from typing import NamedTuple


class TrainingEffort(NamedTuple):
    """Effort on one frame, in place of the schedule's."""

    iterations: int
    """Training iterations."""
    current_rays: int
    """Rays per iteration from the frame at hand, at most; the others come from keyframes."""
