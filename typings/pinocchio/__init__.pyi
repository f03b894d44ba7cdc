"""pinocchio is a compiled module whose folder pyright does not find: its names are looked up when the program runs."""

from typing import Any

def __getattr__(name: str) -> Any: ...
