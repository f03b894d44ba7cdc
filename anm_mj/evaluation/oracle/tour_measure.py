"""What a tour is for: the area under its coverage curve, or its coverage at the end of the budget.

Costs are in steps: a sample that stays uncovered for the whole budget costs the budget divided by the number of
samples.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

MEASURES = ("auc", "end")
"""Area under the curve; value at the end of the budget."""
EARLY_WEIGHT = 0.05
"""Weight of the area beside the end: of two tours with the same end the earlier one is better to begin from."""


@dataclass(frozen=True)
class Measure:
    """What is to be made small: what of ``num_samples`` is not covered within ``budget`` steps."""

    name: str
    """One of ``MEASURES``."""
    budget: int
    num_samples: int

    def cost(self, steps: Int[np.ndarray, " k"], covered: Int[np.ndarray, " k"]) -> float:
        """Mean share of uncovered samples times the budget [steps]: over the budget, or at its end.

        Args:
            steps: Steps after each segment of a tour; the first is 0 or more.
            covered: Samples covered by then. Within a segment they grow evenly, after the last one no more.
        """
        at = np.concatenate([steps[steps < self.budget], [self.budget]]).astype(float)
        share = np.interp(at, steps, covered) / self.num_samples
        # Before the first frame after the start nothing is known to be covered later than it.
        area = float(np.trapezoid(1.0 - share, at)) + float(at[0]) * (1.0 - float(share[0]))
        if self.name == "auc":
            return area
        return self.budget * (1.0 - float(share[-1])) + EARLY_WEIGHT * area
