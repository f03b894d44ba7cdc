"""Finds the storeys of a building and takes one of them."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from anm_mj.errors import SceneError
from anm_mj.scene.importing.canonical_axes import apart, indoor_levels
from anm_mj.scene.raster import areas, clip, clip_to_slab, level_mask
from anm_mj.scene.submesh import Submesh

_SHARE = 0.25
"""A storey has at least this share of the floor of the largest one."""
_APART_M = 1.8
"""Floors nearer to one another belong to one storey: podiums, sunken lounges [m]."""
_SLAB_M = (0.01, 0.8)
"""Depths below the next floor at which its slab may end [m]."""
_WALLS_M = (0.8, 1.4)
"""Heights above a floor at which walls are looked for [m]."""
_WALLED = 0.4
"""A storey's walls spread over more than this share of the extent of the widest one's."""
_EDGE_M = 0.005
_BELOW_M = 0.1
"""So much below a storey's floor still belongs to it [m]."""
_FOUND_M = 0.5
"""A storey is found by a height this near to that of its floor [m]."""


@dataclass(frozen=True)
class Storey:
    """One storey of a building."""

    floor_m: float
    walkable_m2: float
    low_m: float
    high_m: float
    """Highest height that belongs to it; infinite for the uppermost storey [m]."""


def find_storeys(triangles_m: Float[np.ndarray, "f 3 3"]) -> list[Storey]:
    """The storeys of triangles with z up, from the lowest to the highest; at most eight."""
    by_size = sorted(indoor_levels(triangles_m), key=lambda level: -level.walkable_m2)
    large = [level for level in by_size if level.walkable_m2 >= max(_SHARE * by_size[0].walkable_m2, 1.0)]
    found = sorted(apart(large, _APART_M), key=lambda level: level.z_m)
    # Things stand on a floor from one of its ends to the other; on a roof they do not. The ground goes on beyond.
    spread = np.array([_spread(triangles_m, level.z_m) for level in found]).reshape(-1, 2)
    has_walls = (spread > _WALLED * spread.max(axis=0, initial=0.0)).all(axis=1)
    found = [level for level, own in zip(found, has_walls, strict=True) if own]
    if not found:
        return []
    tops = [_top_below(triangles_m, upper.z_m) for upper in found[1:]] + [float("inf")]
    return [
        Storey(level.z_m, level.walkable_m2, level.z_m - _BELOW_M, top) for level, top in zip(found, tops, strict=True)
    ]


def _spread(triangles_m: Float[np.ndarray, "f 3 3"], floor_m: float) -> Float[np.ndarray, "2"]:
    """Extent along x and y of what stands on a floor [m]."""
    above = clip_to_slab(triangles_m, floor_m + _WALLS_M[0], floor_m + _WALLS_M[1])
    return np.ptp(above.reshape(-1, 2), axis=0) if len(above) else np.zeros(2)


def _top_below(triangles_m: Float[np.ndarray, "f 3 3"], floor_m: float) -> float:
    """Where the storey below a floor ends: below the floor's upper side if it has a lower one, or else above it."""
    level = triangles_m[level_mask(triangles_m)]
    z, area = level[:, :, 2].mean(axis=1), areas(level)
    floor_m2 = float(area[np.abs(z - floor_m) < _SLAB_M[0]].sum())
    below = (z < floor_m - _SLAB_M[0]) & (z > floor_m - _SLAB_M[1])
    return floor_m - _EDGE_M if float(area[below].sum()) > 0.5 * floor_m2 else floor_m + _EDGE_M


def pick_storey(storeys: Sequence[Storey], wanted: str) -> Storey:
    """The storey of a number, from 1 at the bottom, or with its floor at a height, such as "3.2" or "3m". Raises
    SceneError if there is no such storey.
    """
    heights = ", ".join(f"{number} at {storey.floor_m:.2f} m" for number, storey in enumerate(storeys, 1)) or "none"
    if re.fullmatch(r"\d{1,9}", wanted.strip()):
        number = int(wanted)
        if not 1 <= number <= len(storeys):
            raise SceneError(f"There is no storey {number}: the storeys are {heights}.")
        return storeys[number - 1]
    try:
        z_m = float(wanted.strip().removesuffix("m"))
    except ValueError as err:
        raise SceneError(
            f"--storey is {wanted!r}: give a number from 1 at the bottom, or the height of the floor, such as 3.2."
        ) from err
    near = [storey for storey in storeys if abs(storey.floor_m - z_m) <= _FOUND_M]
    if not near:
        raise SceneError(f"No storey has its floor near {z_m:g} m: the storeys are {heights}.")
    return min(near, key=lambda storey: abs(storey.floor_m - z_m))


def clip_submesh(submesh: Submesh, low_m: float, high_m: float) -> Submesh | None:
    """The part of a submesh with low <= z <= high, texture included, triangles cut; None if there is none."""
    z = submesh.vertices_m[:, 2]
    if len(z) and z.min() >= low_m and z.max() <= high_m:
        return submesh
    corners = submesh.vertices_m[submesh.faces].astype(np.float64)
    if submesh.uv is not None:
        corners = np.concatenate([corners, submesh.uv[submesh.faces]], axis=2)
    heights = corners[:, :, 2]
    beyond = (heights.max(axis=1) < low_m) | (heights.min(axis=1) > high_m)
    corners, heights = corners[~beyond], heights[~beyond]
    whole = (heights.min(axis=1) >= low_m) & (heights.max(axis=1) <= high_m)
    cut = clip(corners[~whole], low_m, 1.0)
    if np.isfinite(high_m):
        cut = clip(cut, high_m, -1.0)
    fans = np.stack([cut[:, [0, k, k + 1]] for k in range(1, cut.shape[1] - 1)], axis=1)
    fans = fans.reshape(-1, 3, corners.shape[2])
    # Polygons of fewer corners repeat the last one.
    kept = np.concatenate([corners[whole], fans[areas(fans[:, :, :3]) > 0.0]])
    if not len(kept):
        return None
    flat = kept.reshape(-1, kept.shape[2])
    faces = np.arange(len(flat)).reshape(-1, 3)
    return replace(submesh, vertices_m=flat[:, :3], faces=faces, uv=None if submesh.uv is None else flat[:, 3:])
