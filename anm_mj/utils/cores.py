"""Who keeps a core busy beside the native engine, so that its threads do not wait for a core that another one has."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from anm_mj import _native

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
