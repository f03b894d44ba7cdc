"""Compares the gain that targets brought with the gain that was expected of them.

Expected gain can be wrong for ever: space behind a window, a gap that is seen through from one place only. Without a
record the policy would send the robot there again and again. The policy suppresses the cells of a target that failed,
and ends the run after several poor targets in a row.
"""

from __future__ import annotations

from anm_mj.planning.policies.gvg.active_target import ActiveTarget
from anm_mj.planning.policies.gvg.gvg_config import GvgConfig
from anm_mj.types import Pose2


class GainTracker:
    """Counts poor targets in a row."""

    def __init__(self, config: GvgConfig) -> None:
        """Start before the first target."""
        self._config = config
        self.num_poor = 0
        """Targets in a row that brought less than ``poor_target_m2``."""

    def close(self, target: ActiveTarget, *, seen_m2: float, expected_now_m2: float, pose: Pose2) -> bool:
        """Judge a target that the robot has reached or turns away from; whether it brought little of what it promised.

        A target that the robot leaves on the way, and whose view is still expected to bring as much
        (``expected_now_m2``), is not judged.
        """
        standing_m2 = self._config.standing_share * target.expected_gain_m2
        if not target.is_reached(pose) and expected_now_m2 >= standing_m2:
            return False
        gain_m2 = seen_m2 - target.seen_before_m2
        self.num_poor = self.num_poor + 1 if gain_m2 < self._config.poor_target_m2 else 0
        return gain_m2 < self._config.failed_share * target.expected_gain_m2

    def is_exhausted(self, expected_gain_m2: float) -> bool:
        """Whether the last targets were so poor that one with this expected gain is not worth its steps."""
        large = expected_gain_m2 > self._config.large_gain_m2
        return self.num_poor >= self._config.patience_targets * (2 if large else 1)
