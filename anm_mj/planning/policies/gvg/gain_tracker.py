"""Compares the gain that targets brought with the gain that was expected of them.

Expected gain can be wrong for ever: space behind a window, a gap that is seen through from one place only. Without a
record the policy would send the robot there again and again. The policy suppresses the cells of a target that failed,
expects less of its kind of places, and ends the run after several poor targets in a row.

How much of the expected gain comes true is learnt within the run for each kind of place. A gamma prior stands for so
many square metres that came true to the usual share; each target that is judged adds what was expected of its kinds and
what was seen (the posterior mean of a Poisson rate). What a target of several kinds brought counts for those of which
least is expected any more. A poor kind thus costs one look, and its likes are expected to be as poor.
"""

import numpy as np
from jaxtyping import Float, Float32

from anm_mj.planning.policies.gvg.active_target import ActiveTarget
from anm_mj.planning.policies.gvg.gvg_config import GvgConfig
from anm_mj.planning.policies.gvg.information_gain import InformationGain
from anm_mj.planning.policies.gvg.place_kinds import KINDS
from anm_mj.types import Pose2, TargetOutcome

PRIOR_M2 = 10.0
"""Expected gain that the prior stands for [m2]."""
PRIOR_YIELD = np.array([0.3 if kind == "outside" else 1.0 for kind in KINDS])
"""Beyond an edge without floor, something may stand all the same."""
LEAST, MOST = 0.05, 1.0
"""Bounds of a yield: a kind is never given up, and nothing shows more than there is."""
SOME = 1e-3
"""What a target brought is divided among kinds by what each settled, and by this share of what was expected of it."""


class GainYield:
    """The share of the expected gain of each kind that comes true."""

    def __init__(self) -> None:
        self.evidence_m2: Float[np.ndarray, "2 kinds"] = np.zeros((2, len(KINDS)))
        """Of the targets that were judged: what was expected of each kind before its yield, and what came true [m2]."""

    @property
    def of_kind(self) -> Float32[np.ndarray, " kinds"]:
        """The yield of each kind."""
        expected_m2, realised_m2 = self.evidence_m2
        return np.clip((PRIOR_M2 * PRIOR_YIELD + realised_m2) / (PRIOR_M2 + expected_m2), LEAST, MOST).astype(
            np.float32
        )

    def learn(self, expected_m2: Float[np.ndarray, " kinds"], realised_m2: Float[np.ndarray, " kinds"]) -> None:
        """Take in a target that was expected to show so much of each kind, yields included, and what came true [m2]."""
        self.evidence_m2 += expected_m2 / self.of_kind, realised_m2

    def continue_from(self, evidence_m2: Float[np.ndarray, "2 kinds"]) -> None:
        """Begin with what a prior run learnt."""
        self.evidence_m2 = np.maximum(evidence_m2, 0.0)


class GainTracker:
    """Counts poor targets in a row, and learns what the kinds of places yield."""

    def __init__(self, config: GvgConfig) -> None:
        self._config = config
        self.num_poor = 0
        """Targets in a row that brought less than ``poor_target_m2``."""
        self.gain_yield = GainYield()
        """Of the kinds of places."""

    def close(self, target: ActiveTarget, gain: InformationGain, pose: Pose2, *, learns: bool = True) -> TargetOutcome:
        """Judge a target that the robot has reached or turns away from; if it failed, suppress what it was to show.

        A target that the robot leaves on the way, and whose view is still expected to bring as much, is not judged.
        Without ``learns``, what it brought tells nothing of its kind, nor of the patience that is left: views also
        count what they improve.
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
        if learns:
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
