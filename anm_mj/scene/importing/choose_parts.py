"""Choosing parts of a source by name."""

from collections.abc import Collection, Sequence
from fnmatch import fnmatchcase

from anm_mj.errors import SceneError
from anm_mj.scene.importing.readers.import_report import some
from anm_mj.scene.importing.readers.parsed_scene import ParsedScene
from anm_mj.scene.submesh import Submesh


def chosen(parsed: ParsedScene, only: Sequence[str], leave_out: Sequence[str]) -> ParsedScene:
    """A scene with the parts that match a pattern of ``only`` (all if there is none) and none of ``leave_out``.

    Patterns are those of a shell (``door_*``), in small or capital letters alike. One matches a part by its whole path
    or by the name of the part or of anything that it belongs to. Raises SceneError if a pattern matches nothing, or
    nothing is left.
    """
    if not only and not leave_out:
        return parsed
    names = list(dict.fromkeys(part_of(submesh) for submesh in [*parsed.submeshes, *(parsed.obstacles or [])]))
    for pattern in (*only, *leave_out):
        if not any(_matches(name, [pattern]) for name in names):
            raise SceneError(f"No part of the source matches {pattern!r}: it has {some(names)}.")
    kept = {name for name in names if (not only or _matches(name, only)) and not _matches(name, leave_out)}
    if not kept:
        raise SceneError("No part of the source is left: give other patterns with --only or --leave-out.")
    return parsed.changed(
        lambda submesh: submesh if part_of(submesh) in kept else None,
        lambda movable: movable if movable.part in kept else None,
    )


def part_of(submesh: Submesh) -> str:
    """The part that a submesh belongs to; what belongs to none is a part of its own."""
    return submesh.part or submesh.name


def _matches(name: str, patterns: Collection[str]) -> bool:
    """Whether a part, or anything that it belongs to, has a name that one of the patterns describes."""
    words = name.lower().split("/")
    paths = {"/".join(words[:depth]) for depth in range(1, len(words) + 1)} | set(words)
    return any(fnmatchcase(path, pattern.lower().strip("/")) for pattern in patterns for path in paths)
