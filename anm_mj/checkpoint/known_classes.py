"""Which classes and functions a checkpoint may name, and what a class says about its own state."""

import importlib
from collections.abc import Callable
from typing import Any

from anm_mj.errors import CheckpointError

_PACKAGE = __name__.partition(".")[0]
_MAKEABLE = (
    "types",
    "planning",
    "mapping",
    "localisation",
    "sensing",
    "control",
    "robot",
    "geometry",
    "people",
    "ground_truth",
    "evaluation",
    "utils",
    "loop_state",
)
"""Parts of the package whose objects a checkpoint may make. They only compute: none of them writes files, opens
connections or starts programs when it is made without its constructor."""
_RECORDS = ("io.run_records", "sequence_check.frame_fit")
"""Modules of other parts whose objects hold numbers alone."""


class KnownClasses:
    """Classes and functions by name, of parts of this package and of modules that the user has named."""

    def __init__(self, *modules: str) -> None:
        """Allow this package. ``modules`` are further ones, such as that of a policy of the user's own."""
        self._modules = tuple(module for module in modules if module.partition(".")[0] != _PACKAGE)

    def allows(self, module: str) -> bool:
        """Whether objects of the classes of a module may be made."""
        package, _, rest = module.partition(".")
        ours = rest.partition(".")[0] in _MAKEABLE or rest in _RECORDS
        return module in self._modules or (package == _PACKAGE and ours)

    def find(self, name: str) -> Any:
        """The class or function of the name that :func:`name_of` gave. Raises CheckpointError if there is none of that
        name, or it is not allowed.
        """
        module, _, path = name.partition(":")
        if not self.allows(module):
            raise CheckpointError(f"It names {name!r}, which is no part of a run.")
        try:
            found: Any = importlib.import_module(module)
            for part in path.split("."):
                found = vars(found)[part]
        except (ImportError, KeyError, TypeError) as err:
            raise CheckpointError(f"It names {name!r}, which this version does not have.") from err
        found = getattr(found, "__func__", found)  # A static method in the body of its class.
        if getattr(found, "__module__", None) != module or hasattr(found, "__del__"):
            raise CheckpointError(f"It names {name!r}, which is no part of a run.")
        return found

    def find_class(self, name: str) -> type:
        """The class of a name; see :meth:`find`."""
        found = self.find(name)
        if not isinstance(found, type) or issubclass(found, BaseException):
            raise CheckpointError(f"It names {name!r}, which is no class of a run.")
        return found


def name_of(thing: type | Callable[..., Any]) -> str:
    """Module and qualified name of a class or function."""
    return f"{thing.__module__}:{thing.__qualname__}"


def rebuilt_names(cls: type) -> frozenset[str]:
    """Attributes that checkpoints leave out: ``REBUILT`` of a class and of its bases."""
    return frozenset(name for base in cls.__mro__ for name in vars(base).get("REBUILT", ()))


def attributes_of(thing: Any) -> dict[str, Any]:
    """The attributes that a checkpoint stores, by name; those of ``__slots__`` too."""
    left_out = rebuilt_names(type(thing))
    found = dict(vars(thing)) if hasattr(thing, "__dict__") else {}
    for base in type(thing).__mro__:
        slots = vars(base).get("__slots__", ())
        for name in (slots,) if isinstance(slots, str) else slots:
            if name not in ("__dict__", "__weakref__") and hasattr(thing, name):
                found[name] = getattr(thing, name)
    return {name: value for name, value in found.items() if name not in left_out}
