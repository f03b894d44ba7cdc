"""Finds parts that lie far away from everything else: a forgotten lamp half a kilometre off."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int64

from anm_mj.scene.importing.choose_parts import part_of
from anm_mj.scene.raster import areas
from anm_mj.scene.submesh import Submesh

_GAP_M = 30.0
"""Gaps within a building are smaller [m]."""
_SHARE = 0.05
"""What lies apart and has less than this share of the surface is stray; more is another building."""


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
