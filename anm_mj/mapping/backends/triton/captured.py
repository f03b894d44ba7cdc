"""A sequence of launches that becomes a CUDA graph."""

from __future__ import annotations

from collections.abc import Callable

import torch


class Captured:
    """Runs the same launches again and again: on a GPU, from the third time on, by replaying a CUDA graph.

    A graph holds the addresses of all that its launches read and write, and everything that was passed by value. So
    the launches must use arrays that stay where they are, and read from device memory whatever changes.
    """

    def __init__(self, launch: Callable[[], None], *, enabled: bool) -> None:
        """Nothing runs yet.

        Args:
            launch: Does the launches; must not wait for the device.
            enabled: Whether to capture at all; without CUDA there is nothing to capture.
        """
        self._launch = launch
        self._enabled = enabled
        self._compiled = False
        self._graph: torch.cuda.CUDAGraph | None = None

    def run(self) -> None:
        """Do the launches: the first time straight, because that compiles kernels, which cannot be captured."""
        if not (self._enabled and self._compiled):
            self._launch()
            self._compiled = True
            return
        if self._graph is None:
            graph = torch.cuda.CUDAGraph()
            # Capturing records the launches and runs none.
            with torch.cuda.graph(graph):
                self._launch()
            self._graph = graph
        self._graph.replay()
