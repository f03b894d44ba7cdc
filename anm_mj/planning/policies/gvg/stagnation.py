"""Detects stagnation: a window of steps in which next to no new surface was seen."""

import numpy as np
from jaxtyping import Float

from anm_mj.planning.policies.gvg.gvg_config import GvgConfig


class StagnationDetector:
    """Keeps the surface seen at each decision."""

    def __init__(self, config: GvgConfig) -> None:
        self._config = config
        self._step: list[int] = []
        self._seen_m2: list[float] = []

    @property
    def window(self) -> Float[np.ndarray, "n 2"]:
        """Steps, counted back from the last one, and the surface seen by then [m2], as far as the window reaches."""
        if not self._step:
            return np.zeros((0, 2))
        kept = np.column_stack((np.array(self._step) - self._step[-1], self._seen_m2))
        first = int(np.searchsorted(kept[:, 0], -self._length, side="right")) - 1
        return kept[max(0, first) :]

    def continue_from(self, window: Float[np.ndarray, "n 2"]) -> None:
        """Go on from the end of a prior run, which was at :attr:`window`."""
        order = np.argsort(window[:, 0], kind="stable")
        self._step = np.minimum(window[order, 0], 0.0).astype(np.int64).tolist()
        self._seen_m2 = window[order, 1].tolist()

    @property
    def _length(self) -> float:
        """Length of the window [steps]."""
        return max(self._config.stagnation_share * self._step[-1], self._config.min_stagnation_steps)

    def update(self, step: int, seen_m2: float) -> None:
        """Record the surface seen up to a step [m2]; steps must not decrease."""
        self._step.append(step)
        self._seen_m2.append(seen_m2)

    def is_stagnating(self) -> bool:
        """Whether the window up to the last step showed next to no new surface."""
        config = self._config
        before = int(np.searchsorted(self._step, self._step[-1] - self._length, side="right")) - 1
        if before < 0:
            return False
        return self._seen_m2[-1] - self._seen_m2[before] < config.useful_share * self._seen_m2[-1]
