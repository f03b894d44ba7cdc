"""Active neural mapping of indoor scenes with a MuJoCo robot.

The whole of it::

    import anm_mj

    made = anm_mj.explore_scene("home", steps=300)
    run = anm_mj.load_run(made.folder)           # steps, poses, metrics as arrays
    neural_map = anm_mj.load_map(made.folder)    # sdf, rgb, uncertainty, render, mesh

``load_scene``, ``make_robot``, ``make_map`` and ``make_policy`` are the parts, to be put together step by step;
``load_environment`` is an environment to learn in. docs/library.md has examples.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from anm_mj.api import Exploration, LoadedRun, explore_scene, load_map, load_run
    from anm_mj.environments.load import load_environment
    from anm_mj.errors import AnmError
    from anm_mj.events import Observer, Stepped
    from anm_mj.mapping.neural_map import make_map
    from anm_mj.planning.policies.context import make_policy
    from anm_mj.scene.folder import load_scene
    from anm_mj.sim.make_robot import make_robot

__all__ = [
    "AnmError",
    "Exploration",
    "LoadedRun",
    "Observer",
    "Stepped",
    "explore_scene",
    "load_environment",
    "load_map",
    "load_run",
    "load_scene",
    "make_map",
    "make_policy",
    "make_robot",
]

_MODULES = {
    "AnmError": "anm_mj.errors",
    "Observer": "anm_mj.events",
    "Stepped": "anm_mj.events",
    "load_environment": "anm_mj.environments.load",
    "load_scene": "anm_mj.scene.folder",
    "make_map": "anm_mj.mapping.neural_map",
    "make_policy": "anm_mj.planning.policies.context",
    "make_robot": "anm_mj.sim.make_robot",
}
"""Where names stand that do not stand in ``anm_mj.api``."""


if not TYPE_CHECKING:
    # A type checker that saw it would take every misspelt name for one of ours.

    def __getattr__(name: str) -> Any:
        """Names that are looked up when they are first asked for: what stands behind them takes time to load."""
        if name == "_native":
            return _load_native()
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(importlib.import_module(_MODULES.get(name, "anm_mj.api")), name)

    def _load_native() -> Any:
        """The compiled module, for ``from anm_mj import _native``. Raises InstallError if it was not built, does not
        load, or has no kernel for this processor.
        """
        from anm_mj.errors import InstallError

        try:
            native = importlib.import_module("anm_mj._native")
        except ImportError as err:
            raise InstallError(
                f"The compiled part of anm-mj is missing ({err}); install a C++17 compiler (apt install g++) and call "
                "make setup, or pip install ."
            ) from err
        if not native.kernel_names():
            raise InstallError("The compiled part of anm-mj needs a processor with SSE4.2, which this one lacks.")
        return native


def __dir__() -> list[str]:
    """The public names, so that ``help`` and completion show these and nothing else."""
    return sorted([*__all__, *(name for name in globals() if name.startswith("__"))])
