"""Measures wall time per stage."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager


class Stopwatch:
    """Adds up wall milliseconds by stage name."""

    def __init__(self) -> None:
        self.ms: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the wall time of the ``with`` block to a stage."""
        begin = time.perf_counter()
        try:
            yield
        finally:
            self.ms[name] = self.ms.get(name, 0.0) + (time.perf_counter() - begin) * 1e3

    def add(self, other: Stopwatch) -> None:
        """Add the times of another stopwatch, stage by stage."""
        for name, ms in other.ms.items():
            self.ms[name] = self.ms.get(name, 0.0) + ms
