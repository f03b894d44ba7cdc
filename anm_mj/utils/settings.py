"""Settings in frozen dataclasses: each field declares its limits, and their base checks them all.

A number must be above zero and at most a million unless its field says otherwise with :func:`setting`.
"""

import functools
import math
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, ClassVar, Literal, TypeVar, get_origin, get_type_hints

T = TypeVar("T")

_LIMITS = "limits"
_MOST = 1e6
"""Larger numbers have no meaning for a building, but would take hours, or overflow."""


@dataclass(frozen=True)
class Limits:
    """What a field may be; see :func:`setting`."""

    at_least: float | None = None
    at_most: float = _MOST
    below: float = math.inf
    choices: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """The choices or the range in a few characters; empty where the usual limits hold."""
        if self.choices:
            return ", ".join(f"`{choice}`" for choice in self.choices)
        low = "> 0" if self.at_least is None else f"≥ {self.at_least:g}"
        high = f"< {self.below:g}" if self.below <= self.at_most else f"≤ {self.at_most:.10g}"
        return "" if self == Limits() else f"{low}, {high}" if self.at_most < _MOST or self.below <= _MOST else low

    def hold(self, value: Any) -> bool:
        """Whether a value is one of the choices, or a number, or are all of some numbers, within the limits."""
        if isinstance(value, tuple):
            return all(self.hold(each) for each in value)
        if isinstance(value, bool | str):
            return not self.choices or value in self.choices
        above_low = value > 0.0 if self.at_least is None else value >= self.at_least
        # In this order: a whole number too large for a float is no finite one.
        return above_low and value <= self.at_most and value < self.below and math.isfinite(value)

    def __str__(self) -> str:
        """What a value must be, for a message."""
        if self.choices:
            return f"one of {', '.join(self.choices)}"
        low = "above zero" if self.at_least is None else f"at least {self.at_least:g}"
        high = f"below {self.below:g}" if self.below <= self.at_most else f"at most {self.at_most:.10g}"
        return f"a number {low} and {high}"


def setting(
    default: T,
    *,
    at_least: float | None = None,
    at_most: float = _MOST,
    below: float = math.inf,
    choices: tuple[str, ...] = (),
) -> T:
    """A dataclass field with limits.

    Args:
        default: the value that holds without another.
        at_least: smallest number allowed; None = all above zero.
        at_most: largest number allowed.
        below: numbers must be smaller than this.
        choices: the texts allowed; empty = any.
    """
    return field(default=default, metadata={_LIMITS: Limits(at_least, at_most, below, choices)})


def of_type(config: type, name: str, value: Any) -> Any:
    """A value of JSON as the type that a field of a configuration declares; lists become tuples. Raises ValueError if
    it is of another type.
    """
    from anm_mj.utils.read_file import convert  # Settings alone should not cost the import of numpy.

    try:
        return convert(value, _hints(config)[name])
    except TypeError:
        # A policy of the user's own may declare types that files know nothing of.
        return tuple(value) if isinstance(value, list) else value


@functools.cache
def _hints(config: type) -> dict[str, Any]:
    """Types of the fields; choices are texts here, because :class:`Settings` says best what they may be."""
    hints = get_type_hints(config)
    return {name: str if get_origin(hint) is Literal else hint for name, hint in hints.items()}


def limits_of(config: Any, name: str) -> Limits:
    """What a field of a configuration may be."""
    (limits,) = (entry.metadata.get(_LIMITS, Limits()) for entry in fields(config) if entry.name == name)
    return limits


def broken_limits(config: Any, name: str, value: Any) -> str:
    """What a field must be, for a message, where it cannot have a value; else empty."""
    limits = limits_of(config, name)
    return "" if limits.hold(value) else str(limits)


class Settings:
    """Base of frozen dataclasses of settings, which raise ``error`` for a field outside of its limits.

    A subclass names its ``group``, which precedes a field's name in messages, such as ``planning``, and the ``error``.
    """

    _group: ClassVar[str]
    _error: ClassVar[type[Exception]]

    def __init_subclass__(cls, *, group: str = "", error: type[Exception] | None = None) -> None:
        if error is not None:
            cls._group, cls._error = group, error

    def __post_init__(self) -> None:
        for entry in fields(self):  # pyright: ignore[reportArgumentType]
            value = getattr(self, entry.name)
            # A part that is a configuration of its own has checked itself.
            if not is_dataclass(value) and (wanted := broken_limits(self, entry.name, value)):
                text = f"'{value}'" if isinstance(value, str) else value
                raise self._error(f"{self._group}.{entry.name} is {text}; it must be {wanted}.")
