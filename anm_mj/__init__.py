"""Active neural mapping of indoor scenes with a MuJoCo robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from anm_mj.environments.load import load_environment

__all__ = ["load_environment"]


def __getattr__(name: str) -> Any:
    """Names that are looked up when they are first asked for: what stands behind them takes time to load."""
    if name == "load_environment":
        from anm_mj.environments.load import load_environment

        return load_environment
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
