"""What each target promised and what it brought: predictions that fail are not believed twice, and say when to stop.

A panorama may promise what no view ever shows: space behind a window, a gap that only one place looks through. The
robot would be sent there again and again. When it turns from a target to another, what it has come to see in between
is compared with what was promised. If that was next to nothing, what made the promise is expected from nearer only.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from anm_mj.frames import wrap_angle
from anm_mj.planning.policies.gvg.config import GvgConfig
from anm_mj.planning.policies.gvg.tour import SIDE
from anm_mj.planning.policies.gvg.travel_costs import NUM_AZIMUTHS
from anm_mj.types import ARRIVED_M, TURN_STEP_RAD, Pose2

KEPT_SHARE = 0.25
"""A promise was kept if at least this share of it came true."""
STANDING_SHARE = 0.5
"""A promise still stands as long as the view there is expected to show this share of it."""


class GainTracker:
    """The present target and the record of the last ones."""

    def __init__(self, config: GvgConfig):
        """Start without a target."""
        self.config = config
        self.poor_in_a_row = 0
        """Targets in a row that brought less than ``poor_target_m2``."""
        self.target_xy_m: Float[np.ndarray, 2] | None = None
        """Where the robot is sent; None before the first target and after an obstacle."""
        self.heading = 0
        """Azimuth sector to look along there, of 10 degrees each."""
        self.promised_m2 = 0.0
        """New surface expected there when the robot set out [m2]."""
        self._promised_at_m, self._promised_along = np.zeros(2), 0
        self._seen_before_m2 = 0.0

    def is_target(self, xy_m: Float[np.ndarray, 2]) -> bool:
        """Whether a place is the present target: vertices move a little with every new frame."""
        if self.target_xy_m is None:
            return False
        return float(np.linalg.norm(xy_m - self.target_xy_m)) < self.config.candidate_spacing_m

    def is_promised(self, xy_m: Float[np.ndarray, 2], heading: int) -> bool:
        """Whether a view is the one that made the promise, or shows most of the same: a target may creep from it."""
        turns = abs((heading - self._promised_along + NUM_AZIMUTHS // 2) % NUM_AZIMUTHS - NUM_AZIMUTHS // 2)
        near = float(np.linalg.norm(xy_m - self._promised_at_m)) < self.config.candidate_spacing_m
        return self.is_target(xy_m) and near and turns <= SIDE

    def is_done(self, pose: Pose2) -> bool:
        """Whether the robot has come to the target and looks as it was to look there."""
        if self.target_xy_m is None:
            return False
        there = float(np.linalg.norm(self.target_xy_m - pose.xy_m)) < 2 * ARRIVED_M
        return there and abs(wrap_angle(self.heading * TURN_STEP_RAD - pose.yaw_rad)) < TURN_STEP_RAD

    def settle(self, seen_m2: float, still_m2: float, pose: Pose2) -> bool:
        """Close the account of the present target.

        A target that the robot turns from on the way, while it promises as much as ever, is no failure.

        Args:
            seen_m2: surface seen so far [m2].
            still_m2: what the view there promises now [m2].
            pose: where the robot stands.

        Returns:
            Whether the promise failed.
        """
        done = self.is_done(pose)
        self.target_xy_m = None
        if not done and still_m2 >= STANDING_SHARE * self.promised_m2:
            return False
        brought = seen_m2 - self._seen_before_m2
        self.poor_in_a_row = self.poor_in_a_row + 1 if brought < self.config.poor_target_m2 else 0
        return brought < KEPT_SHARE * self.promised_m2

    def open(self, xy_m: Float[np.ndarray, 2], heading: int, promised_m2: float, seen_m2: float) -> None:
        """Set out for a target.

        Args:
            xy_m: where it lies [m].
            heading: azimuth sector to look along there.
            promised_m2: new surface expected [m2].
            seen_m2: surface seen so far [m2].
        """
        self.follow(xy_m, heading)
        self._promised_at_m, self._promised_along = xy_m, heading
        self.promised_m2, self._seen_before_m2 = promised_m2, seen_m2

    def follow(self, xy_m: Float[np.ndarray, 2], heading: int) -> None:
        """Take the view that now stands for the promised one as the target; the promise stays what and where it was.

        Args:
            xy_m: where it lies [m].
            heading: azimuth sector to look along there.
        """
        self.target_xy_m, self.heading = xy_m, heading

    def is_exhausted(self, promised_m2: float) -> bool:
        """Whether the last targets brought so little that one which promises this much is not worth its way."""
        patience = self.config.patience_targets * (2 if promised_m2 > self.config.large_gain_m2 else 1)
        return self.poor_in_a_row >= patience
