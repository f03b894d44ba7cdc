"""mujoco is a compiled module without stubs: its names are looked up when the program runs."""

from typing import Any

def __getattr__(name: str) -> Any: ...
