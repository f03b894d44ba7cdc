"""What each target promised and what it brought: predictions that fail are not believed twice, and say when to stop.

A panorama may promise what no view ever shows: space behind a window, a gap that only one place looks through. The
robot would be sent there again and again. When it turns from a target to another, what it has come to see in between
is compared with what was promised. If that was next to nothing, the unknown that made the promise is given up.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from anm_mj.frames import wrap_angle
from anm_mj.planning.config import PlanningConfig
from anm_mj.types import ARRIVED_M, TURN_STEP_RAD, Pose2

KEPT_SHARE = 0.25
"""A promise was kept if at least this share of it came true."""


class Ledger:
    """The present target and the record of the last ones."""

    def __init__(self, config: PlanningConfig):
        """Start without a target."""
        self.config = config
        self.poor_in_a_row = 0
        """Targets in a row that brought less than ``poor_target_m2``."""
        self.target_xy_m: Float[np.ndarray, 2] | None = None
        """Where the robot is sent; None before the first target and after an obstacle."""
        self._yaw_rad = 0.0
        self._promised_m2 = 0.0
        self._seen_before_m2 = 0.0
        self._cells = np.zeros(0, np.int64)
        self._epoch = -1

    def is_target(self, xy_m: Float[np.ndarray, 2]) -> bool:
        """Whether a place is the present target: vertices move a little with every new frame."""
        if self.target_xy_m is None:
            return False
        return float(np.linalg.norm(xy_m - self.target_xy_m)) < self.config.candidate_spacing_m

    def is_done(self, pose: Pose2) -> bool:
        """Whether the robot has come to the target and looks as it was to look there."""
        if self.target_xy_m is None:
            return False
        there = float(np.linalg.norm(self.target_xy_m - pose.xy_m)) < 2 * ARRIVED_M
        return there and abs(wrap_angle(self._yaw_rad - pose.yaw_rad)) < TURN_STEP_RAD

    def settle(self, seen_m2: float, epoch: int) -> Int[np.ndarray, " n"]:
        """Close the account of the present target.

        Args:
            seen_m2: surface seen so far [m2].
            epoch: of the view grid.

        Returns:
            The unknown cells, by flat index, that promised what did not come true.
        """
        if self.target_xy_m is None:
            return np.zeros(0, np.int64)
        self.target_xy_m = None
        brought = seen_m2 - self._seen_before_m2
        self.poor_in_a_row = self.poor_in_a_row + 1 if brought < self.config.poor_target_m2 else 0
        if brought >= KEPT_SHARE * self._promised_m2 or epoch != self._epoch:
            return np.zeros(0, np.int64)
        return self._cells

    def open(
        self,
        xy_m: Float[np.ndarray, 2],
        yaw_rad: float,
        promised_m2: float,
        seen_m2: float,
        cells: Int[np.ndarray, " n"],
        epoch: int,
    ) -> None:
        """Set out for a target.

        Args:
            xy_m: where it lies [m].
            yaw_rad: heading to look along there.
            promised_m2: new surface expected [m2].
            seen_m2: surface seen so far [m2].
            cells: unknown cells, by flat index, that are expected to come into view there.
            epoch: of the view grid that the indices belong to.
        """
        self.target_xy_m, self._yaw_rad = xy_m, yaw_rad
        self._promised_m2, self._seen_before_m2 = promised_m2, seen_m2
        self._cells, self._epoch = cells, epoch

    def is_exhausted(self, promised_m2: float) -> bool:
        """Whether the last targets brought so little that one which promises this much is not worth its way."""
        patience = self.config.patience_targets * (2 if promised_m2 > self.config.large_gain_m2 else 1)
        return self.poor_in_a_row >= patience
