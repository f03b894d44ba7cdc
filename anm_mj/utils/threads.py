"""How many threads numerical work gets."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from anm_mj import _native


def usual_num_threads() -> int:
    """As ``OMP_NUM_THREADS`` says, like OpenMP and torch; without it, one per core that the process may use."""
    try:
        asked = int(os.environ.get("OMP_NUM_THREADS", "").partition(",")[0])
    except ValueError:
        asked = 0
    if asked > 0:
        return asked
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # Not on macOS.
        return os.cpu_count() or 1


_lock = threading.Lock()
_lent = 0


@contextmanager
def lent_core() -> Iterator[None]:
    """While this goes on, another thread computes on one of the cores; the native engine does with one less."""
    _change(1)
    try:
        yield
    finally:
        _change(-1)


def _change(by: int) -> None:
    global _lent
    with _lock:
        _lent += by
        _native.lend_cores(_lent)
