"""Notices a robot that does not follow its wheels although nothing is in the way: it slides, or cannot move."""

from __future__ import annotations

from anm_mj.types import StopReason

_FAILURES = 6
"""Actions in a row that fail without contact, until the robot is given up."""


class TractionMonitor:
    """Counts actions that did not bring the base to where they should, without anything in the way."""

    def __init__(self) -> None:
        """Start without a failure."""
        self._failures = 0

    def after(self, *, failed: bool, touched: bool) -> StopReason | None:
        """NO_TRACTION after several failures in a row; None before.

        Args:
            failed: the action ended away from where it should.
            touched: an obstacle may be the reason.
        """
        self._failures = self._failures + 1 if failed and not touched else 0
        return StopReason.NO_TRACTION if self._failures >= _FAILURES else None
