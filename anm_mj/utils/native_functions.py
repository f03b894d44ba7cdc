"""The functions of the native engine that stand beside the engine itself.

An engine that was built before one of them was made lacks it, and where there is no compiler there is none at all; the
NumPy code that each of them is tested against computes the same then.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any


def native_function(name: str) -> Callable[..., Any] | None:
    """A function of the engine's module; None where it was not built."""
    try:
        native = importlib.import_module("anm_mj._native")
    except ImportError:
        return None
    return getattr(native, name, None)
