"""Compares the gain that targets brought with the gain that was expected of them.

Expected gain can be wrong for ever: space behind a window, a gap that is seen through from one place only. Without a
record the policy would send the robot there again and again. The policy suppresses the cells of a target that failed,
expects less of its kind of places (:mod:`anm_mj.planning.policies.gvg.gain_yield`), and ends the run after several poor
targets in a row.
"""

import numpy as np

from anm_mj.planning.policies.gvg.active_target import ActiveTarget
from anm_mj.planning.policies.gvg.gain_yield import GainYield
from anm_mj.planning.policies.gvg.gvg_config import GvgConfig
from anm_mj.planning.policies.gvg.information_gain import InformationGain
from anm_mj.planning.policies.gvg.place_kinds import KINDS
from anm_mj.types import Pose2, TargetOutcome

SOME = 1e-3
"""What a target brought is divided among kinds by what each settled, and by this share of what was expected of it."""


class GainTracker:
    """Counts poor targets in a row, and learns what the kinds of places yield."""

    def __init__(self, config: GvgConfig) -> None:
        """Start before the first target."""
        self._config = config
        self.num_poor = 0
        """Targets in a row that brought less than ``poor_target_m2``."""
        self.gain_yield = GainYield()
        """Of the kinds of places."""

    def close(self, target: ActiveTarget, gain: InformationGain, pose: Pose2, *, learns: bool = True) -> TargetOutcome:
        """Judge a target that the robot has reached or turns away from; if it failed, suppress what it was to show.

        A target that the robot leaves on the way, and whose view is still expected to bring as much, is not judged.
        Without ``learns``, what it brought tells nothing of its kind: views also count what they improve.
        """
        view = gain.expected_view(target.viewpoint)
        standing_m2 = self._config.standing_share * target.view.gain_m2
        judged = target.is_reached(pose) or view.gain_m2 < standing_m2
        realised_m2 = gain.seen_m2 - target.seen_before_m2
        kind = KINDS[int(target.view.of_kind_m2.argmax())]
        promised_m2, expected_m2 = target.promised_m2, target.done_m2(gain, reached=target.is_reached(pose))
        outcome = TargetOutcome(target.viewpoint.xy_m, kind, promised_m2, expected_m2, realised_m2, judged)
        if not judged:
            return outcome
        self.num_poor = self.num_poor + 1 if realised_m2 < self._config.poor_target_m2 else 0
        if realised_m2 < self._config.failed_share * target.expected_gain_m2:
            gain.suppress(view.cells, view.distance_m)
        before_m2 = target.view.of_kind_m2
        if learns and before_m2.any():
            settled_m2 = np.maximum(before_m2 - view.of_kind_m2, 0.0) + SOME * before_m2
            expected_m2, brought_m2 = (
                total * part / part.sum()
                for total, part in ((target.expected_gain_m2, before_m2), (realised_m2, settled_m2))
            )
            self.gain_yield.learn(expected_m2, brought_m2)
            gain.expect_yields(self.gain_yield.of_kind)
        return outcome

    def is_exhausted(self, expected_gain_m2: float) -> bool:
        """Whether the last targets were so poor that one with this expected gain is not worth its steps."""
        large = expected_gain_m2 > self._config.large_gain_m2
        return self.num_poor >= self._config.patience_targets * (2 if large else 1)
