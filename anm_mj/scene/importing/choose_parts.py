"""Choosing parts of a source: by name, and not those that lie far away, such as a lamp half a kilometre off."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

import numpy as np
from jaxtyping import Float, Int64

from anm_mj.errors import SceneError
from anm_mj.scene.importing.readers.import_report import some
from anm_mj.scene.importing.readers.parsed_scene import ParsedScene
from anm_mj.scene.raster import areas
from anm_mj.scene.submesh import Submesh, is_within

_GAP_M = 30.0
"""Gaps within a building are smaller [m]."""
_SHARE = 0.05
"""What lies apart and has less than this share of the surface is stray; more is another building."""


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
        # Its body may have no submesh of its own, but those of the bodies that hang on it.
        lambda movable: movable if any(is_within(name, [movable.part]) for name in kept) else None,
    )


def part_of(submesh: Submesh) -> str:
    """The part that a submesh belongs to; what belongs to none is a part of its own."""
    return submesh.part or submesh.name


def path_to(part: str) -> list[str]:
    """All that a part belongs to, from the outermost, and it itself."""
    words = part.split("/")
    return ["/".join(words[:depth]) for depth in range(1, len(words) + 1)]


def _matches(name: str, patterns: Collection[str]) -> bool:
    """Whether a part, or anything that it belongs to, has a name that one of the patterns describes."""
    paths = {*path_to(name.lower()), *name.lower().split("/")}
    return any(fnmatchcase(path, pattern.lower().strip("/")) for pattern in patterns for path in paths)


def split_stray(submeshes: Sequence[Submesh], metres_per_unit: float) -> tuple[list[Submesh], dict[str, float]]:
    """The submeshes without what lies far from most of the surface, and how far away each part of that lies [m]."""
    filled = [submesh for submesh in submeshes if len(submesh.faces)]
    if not filled:
        return list(submeshes), {}
    corners = [submesh.vertices_m[submesh.faces] * metres_per_unit for submesh in filled]
    low = np.concatenate([own.min(axis=1) for own in corners])
    high = np.concatenate([own.max(axis=1) for own in corners])
    if float((high.max(axis=0) - low.min(axis=0)).max()) <= _GAP_M:
        return list(submeshes), {}
    area = np.concatenate([areas(own) for own in corners])
    piece = _pieces(low, high)
    size = np.bincount(piece, weights=area)
    main = int(np.argmax(size))
    stray = (piece != main) & (size[piece] < _SHARE * size[main])
    if not stray.any():
        return list(submeshes), {}
    main_low, main_high = low[piece == main].min(axis=0), high[piece == main].max(axis=0)
    away = np.linalg.norm(np.maximum(np.maximum(main_low - high, low - main_high), 0.0), axis=1)
    kept, found = [], {}
    first = 0
    for submesh in filled:
        own = slice(first, first + len(submesh.faces))
        first = own.stop
        if stray[own].any():
            name = part_of(submesh)
            found[name] = max(found.get(name, 0.0), float(away[own][stray[own]].max()))
        faces = submesh.faces[~stray[own]]
        if len(faces):
            kept.append(submesh if len(faces) == len(submesh.faces) else replace(submesh, faces=faces))
    return kept, found


def _pieces(low: Float[np.ndarray, "f 3"], high: Float[np.ndarray, "f 3"]) -> Int64[np.ndarray, " f"]:
    """The number of the piece of every triangle; between pieces lie gaps, along some axis, that nothing bridges."""
    piece = np.zeros(len(low), dtype=np.int64)
    todo, num = [np.arange(len(low))], 1
    while todo:
        members = todo.pop()
        for axis in range(3):
            parts = _split(low[members, axis], high[members, axis])
            if len(parts) > 1:
                for part in parts[1:]:
                    piece[members[part]] = num
                    num += 1
                todo += [members[part] for part in parts]
                break
    return piece


def _split(low: Float[np.ndarray, " f"], high: Float[np.ndarray, " f"]) -> list[Int64[np.ndarray, " n"]]:
    """The indices of intervals in groups with wide gaps between them."""
    order = np.argsort(low, kind="stable")
    reach = np.maximum.accumulate(high[order])
    cuts = np.flatnonzero(low[order][1:] - reach[:-1] > _GAP_M) + 1
    return np.split(order, cuts)
