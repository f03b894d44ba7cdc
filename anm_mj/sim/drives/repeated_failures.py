"""Gives up a robot that fails several times in a row with nothing in the way: it slides, or a wheel sticks."""

import logging

from anm_mj.types import StopReason

_logger = logging.getLogger(__name__)

_FAILURES = 6
"""Actions in a row, or motions that drive a wheel as far as a turn, that fail without contact until the robot is given
up."""
_TURNED_SHARE = 0.1
"""A wheel that turns by less than this share of what it was driven by sticks."""
_SIDES = "left", "right"


class RepeatedFailures:
    """Counts actions that did not bring the base to where they should, or a wheel, without anything in the way."""

    def __init__(self) -> None:
        self._failures = 0
        self._stuck = [0, 0]
        self._driven_rad, self._turned_rad = [0.0, 0.0], [0.0, 0.0]
        """Of each side since it was judged."""

    def after(
        self,
        *,
        failed: bool,
        touched: bool,
        driven_rad: tuple[float, float],
        turned_rad: tuple[float, float],
        least_rad: float = 0.0,
    ) -> StopReason | None:
        """WHEEL_STUCK or NO_TRACTION after several failures in a row; None before.

        An action ``failed`` if it ended away from where it should; an obstacle may be the reason if something was
        ``touched``. ``driven_rad`` is the rotation of the left and the right wheel that the action asks for,
        ``turned_rad`` what their encoders measured. A motion may be any part of an action: a wheel is judged once it
        was driven by ``least_rad`` since the last time.
        """
        self._failures = self._failures + 1 if failed and not touched else 0
        for side in range(2):
            self._driven_rad[side] += abs(driven_rad[side])
            self._turned_rad[side] += abs(turned_rad[side])
            driven, turned = self._driven_rad[side], self._turned_rad[side]
            if driven < least_rad and not touched:
                continue
            self._driven_rad[side] = self._turned_rad[side] = 0.0
            # What an obstacle stops says nothing about the wheels.
            if turned >= _TURNED_SHARE * driven:
                # A wheel that was not driven shows nothing.
                if driven > 0.0:
                    self._stuck[side] = 0
            elif not touched:
                self._stuck[side] += 1
                if self._stuck[side] == 1:
                    _logger.warning(
                        "The %s wheel turned by %.2f rad where it was driven by %.2f rad.", _SIDES[side], turned, driven
                    )
        if max(self._stuck) >= _FAILURES:
            return StopReason.WHEEL_STUCK
        return StopReason.NO_TRACTION if self._failures >= _FAILURES else None
