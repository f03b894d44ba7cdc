"""The parameters of the map as they were when all of them were finite, to go back to when training fails."""

from __future__ import annotations

import logging

import numpy as np

from anm_mj.mapping.backends.backend import MapperBackend, Parameters
from anm_mj.mapping.backends.grid_layout import doubled_table
from anm_mj.mapping.mapping_config import FieldConfig

_logger = logging.getLogger(__name__)

KEEP_EVERY_FRAMES = 20
"""A copy of the parameters costs milliseconds; a loss that is not finite takes back this many frames at most."""


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
        """Keep the parameters before a frame; False, with the earlier ones kept, where one is not finite."""
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

    def keep_or_restore(self, backend: MapperBackend, frame: int, step: int) -> None:
        """Keep the engine's parameters before a frame, or take it back where one of them is not finite.

        Args:
            backend: the engine.
            frame: number of frames that it was trained on.
            step: of the last one, for the log.
        """
        if not self.keep(backend.parameters(), frame):
            self.restore(backend, frame, f"Parameters of the map were not finite any more at step {step}")

    def finite_parameters(self, backend: MapperBackend, frame: int) -> Parameters:
        """The engine's parameters; it is taken back first where one of them is not finite."""
        parameters = backend.parameters()
        if are_finite(parameters) or self._parameters is None:
            return parameters
        self.restore(backend, frame, "Parameters of the map were not finite any more")
        return backend.parameters()

    def restore(self, backend: MapperBackend, frame: int, why: str) -> None:
        """Give an engine the parameters that were kept, and let its optimiser start afresh.

        Args:
            backend: the engine.
            frame: number of frames that it was trained on.
            why: the beginning of the sentence that is logged.
        """
        if self._parameters is None:
            _logger.warning("%s, and no good ones were kept.", why)
            return
        ago = f" {frame - self._frame} frames ago" if frame > self._frame else " before"
        _logger.warning("%s; the map goes back to what it was%s.", why, ago)
        backend.set_parameters(self._parameters)


def are_finite(parameters: Parameters) -> bool:
    """Whether no parameter is NaN or infinite, nor so large that their sum overflows."""
    with np.errstate(over="ignore", invalid="ignore"):
        return all(bool(np.isfinite(array.sum())) for array in parameters.values())
