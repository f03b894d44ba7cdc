"""Who keeps a core busy beside the native engine, so that its threads do not wait for a core that another one has."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_lock = threading.Lock()
_lent = 0
_listeners: list[Callable[[int], None]] = []


def tell_lent(listener: Callable[[int], None]) -> None:
    """Have a function called with the number of lent cores whenever it changes."""
    with _lock:
        _listeners.append(listener)
        listener(_lent)


def num_lent() -> int:
    """How many cores are lent by now."""
    return _lent


@contextmanager
def lent_core() -> Iterator[None]:
    """While this goes on, another thread computes on one of the cores; what else is computed does with one less."""
    _change(1)
    try:
        yield
    finally:
        _change(-1)


def _change(by: int) -> None:
    global _lent
    with _lock:
        _lent += by
        for listener in _listeners:
            listener(_lent)
