"""Choosing parts of a source by name."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

from anm_mj.errors import SceneError
from anm_mj.scene.importing.readers.parsed_scene import ParsedScene
from anm_mj.scene.submesh import Submesh

_NAMED = 12


def chosen(parsed: ParsedScene, only: Sequence[str], leave_out: Sequence[str]) -> ParsedScene:
    """A scene with the parts that match a pattern of ``only`` (all if there is none) and none of ``leave_out``.

    Patterns are those of a shell (``door_*``), in small or capital letters alike. One matches a part by its whole path
    or by the name of the part or of anything that it belongs to.

    Raises:
        SceneError: if a pattern matches nothing, or nothing is left.
    """
    if not only and not leave_out:
        return parsed
    names = part_names(parsed)
    for pattern in (*only, *leave_out):
        if not any(matches(name, [pattern]) for name in names):
            raise SceneError(f"No part of the source matches {pattern!r}: it has {some(names)}.")
    kept = {name for name in names if (not only or matches(name, only)) and not matches(name, leave_out)}
    if not kept:
        raise SceneError("No part of the source is left: give other patterns with --only or --leave-out.")
    return filtered(parsed, kept.__contains__)


def filtered(parsed: ParsedScene, keep: Callable[[str], bool]) -> ParsedScene:
    """A scene with the parts whose names are to be kept."""
    return replace(
        parsed,
        submeshes=[submesh for submesh in parsed.submeshes if keep(part_of(submesh))],
        obstacles=None if parsed.obstacles is None else [own for own in parsed.obstacles if keep(part_of(own))],
        movables=tuple(movable for movable in parsed.movables if keep(movable.part)),
    )


def part_of(submesh: Submesh) -> str:
    """The part that a submesh belongs to; what belongs to none is a part of its own."""
    return submesh.part or submesh.name


def part_names(parsed: ParsedScene) -> list[str]:
    """The names of all parts, in order."""
    return list(dict.fromkeys(part_of(submesh) for submesh in [*parsed.submeshes, *(parsed.obstacles or [])]))


def matches(name: str, patterns: Collection[str]) -> bool:
    """Whether a part, or anything that it belongs to, has a name that one of the patterns describes."""
    words = name.lower().split("/")
    paths = {"/".join(words[:depth]) for depth in range(1, len(words) + 1)} | set(words)
    return any(fnmatchcase(path, pattern.lower().strip("/")) for pattern in patterns for path in paths)


def some(names: Collection[str], number: int = _NAMED) -> str:
    """The first names of many, and how many more there are."""
    first = ", ".join(list(names)[:number])
    return first if len(names) <= number else f"{first} and {len(names) - number} more"
