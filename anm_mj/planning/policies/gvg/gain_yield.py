"""How much of the gain that is expected of places comes true, learnt within the run for each kind of place.

A gamma prior stands for so many square metres that came true to the usual share; each target that is judged adds what
was expected of its kinds and what was seen (the posterior mean of a Poisson rate). What a target of several kinds
brought counts for those of which least is expected any more. A poor kind thus costs one look, and its likes are
expected to be as poor.
"""

import numpy as np
from jaxtyping import Float, Float32

from anm_mj.planning.policies.gvg.place_kinds import KINDS

PRIOR_M2 = 10.0
"""Expected gain that the prior stands for [m2]."""
PRIOR_YIELD = np.array([0.3 if kind == "outside" else 1.0 for kind in KINDS])
"""Beyond an edge without floor, something may stand all the same."""
LEAST, MOST = 0.05, 1.0
"""Bounds of a yield: a kind is never given up, and nothing shows more than there is."""


class GainYield:
    """The share of the expected gain of each kind that comes true."""

    def __init__(self) -> None:
        """Start with the prior."""
        self._evidence_m2 = np.zeros((2, len(KINDS)))

    @property
    def evidence_m2(self) -> Float[np.ndarray, "2 kinds"]:
        """Of the targets that were judged: what was expected of each kind before its yield, and what came true [m2]."""
        return self._evidence_m2

    @property
    def of_kind(self) -> Float32[np.ndarray, " kinds"]:
        """The yield of each kind."""
        expected_m2, realised_m2 = self._evidence_m2
        return np.clip((PRIOR_M2 * PRIOR_YIELD + realised_m2) / (PRIOR_M2 + expected_m2), LEAST, MOST).astype(
            np.float32
        )

    def learn(self, expected_m2: Float[np.ndarray, " kinds"], realised_m2: Float[np.ndarray, " kinds"]) -> None:
        """Take in a target that was expected to show so much of each kind, yields included, and what came true [m2]."""
        self._evidence_m2 += expected_m2 / self.of_kind, realised_m2

    def continue_from(self, evidence_m2: Float[np.ndarray, "2 kinds"]) -> None:
        """Begin with what a prior run learnt."""
        self._evidence_m2 = np.maximum(evidence_m2, 0.0)
