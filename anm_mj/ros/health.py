"""What is wrong with a live robot at the moment, each in one sentence that names the topic."""

import threading
import time
from collections.abc import Callable

_JUMP_S = 1.0
"""A clock that goes back, or ahead by more than this between two messages, has jumped [s]."""
_HOLD_S = 0.5
"""A fault that comes with a message holds for so long [s]; a later one prolongs it."""
_REPEATS = 0.5
"""A stamp that is said again after this part of the timeout tells what silence tells after all of it."""


class Health:
    """Collects faults from all threads; the robot drives only while there is none."""

    def __init__(self, timeout_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        """Nothing is wrong yet; sources fall silent after ``timeout_s``, by a clock of seconds."""
        self._timeout_s, self._clock = timeout_s, clock
        self._lock = threading.Lock()
        self._heard: dict[str, tuple[float, float]] = {}
        """By what must go on: when it was heard last, by this clock and by its stamp [s]."""
        self._again: dict[str, float] = {}
        """By what must go on: how long its present stamp has been said again and again [s]."""
        self._faults: dict[str, tuple[str, float]] = {}
        """By topic: the sentence, and until when it holds [s]."""

    def expect(self, source: str) -> None:
        """From now on, a source such as ``the depth on /camera/depth`` must go on."""
        with self._lock:
            self._heard.setdefault(source, (self._clock(), 0.0))

    def hear(self, source: str, stamp_s: float) -> None:
        """A source goes on if its stamps do; a stamp that jumps is a fault."""
        now = self._clock()
        with self._lock:
            before = self._heard.get(source)
            if before is not None and stamp_s == before[1]:
                # What is only said again is as old as it was.
                self._again[source] = now - before[0]
                return
            self._heard[source], self._again[source] = (now, stamp_s), 0.0
        if before is not None and before[1] and not -1e-6 <= stamp_s - before[1] <= _JUMP_S + now - before[0]:
            self.fault(source, f"the clock of {source} jumped by {stamp_s - before[1]:+.2f} s")

    def fault(self, source: str, sentence: str, hold_s: float = _HOLD_S) -> None:
        """Something is wrong for a while [s]."""
        with self._lock:
            self._faults[source] = sentence, self._clock() + hold_s

    def present(self) -> str | None:
        """What is wrong now; None while nothing is."""
        now = self._clock()
        with self._lock:
            for sentence, until in self._faults.values():
                if now < until:
                    return sentence
            for source, (last, _) in self._heard.items():
                if now - last > self._timeout_s:
                    return f"nothing was heard of {source} for {self._timeout_s:g} s"
                if self._again.get(source, 0.0) > _REPEATS * self._timeout_s:
                    return f"{source} says the same again and again"
        return None
