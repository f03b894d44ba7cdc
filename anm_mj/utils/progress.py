"""How far a long computation is, for whoever shows it."""

from collections.abc import Callable

Progress = Callable[[int, int], None]
"""Called with what is done and in all."""


def unheard(done: int, total: int) -> None:
    """Nobody is shown it."""
