"""The parameters of the map as they were when all of them were finite, to go back to when training fails."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32

from anm_mj.mapping.config import FieldConfig
from anm_mj.mapping.grid_layout import doubled_table

KEEP_EVERY_FRAMES = 20
"""A copy of the parameters costs milliseconds; a loss that is not finite takes back this many frames at most."""

Parameters = dict[str, Float32[np.ndarray, "..."]]
"""Parameters of the field by name, as of :class:`anm_mj.mapping.backends.backend.MapperBackend`."""


class LastGood:
    """Keeps a copy of the parameters in memory, as long as they are finite."""

    def __init__(self) -> None:
        """Hold nothing yet."""
        self._parameters: Parameters | None = None
        self._frame = 0

    def is_due(self, frame: int) -> bool:
        """Whether the parameters before a frame should be kept."""
        return self._parameters is None or frame - self._frame >= KEEP_EVERY_FRAMES

    def keep(self, parameters: Parameters, frame: int) -> bool:
        """Keep the parameters before a frame; False, with the former ones kept, where one is not finite."""
        if not are_finite(parameters):
            return False
        self._parameters, self._frame = parameters, frame
        return True

    def double_table(self, field: FieldConfig) -> None:
        """Follow the field's table, which has just been doubled.

        Args:
            field: its settings before.
        """
        if self._parameters is not None:
            self._parameters = {**self._parameters, "table": doubled_table(self._parameters["table"], field)}

    @property
    def parameters(self) -> Parameters | None:
        """What was kept last; None where nothing was."""
        return self._parameters

    @property
    def frame(self) -> int:
        """Number of frames that it was learnt from."""
        return self._frame


def are_finite(parameters: Parameters) -> bool:
    """Whether no parameter is NaN or infinite, nor so large that their sum overflows."""
    with np.errstate(over="ignore", invalid="ignore"):
        return all(bool(np.isfinite(array.sum())) for array in parameters.values())
