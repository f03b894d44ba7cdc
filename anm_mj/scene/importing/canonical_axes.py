"""Finds unit, up axis and floor of a scene from its triangles.

Files are unreliable here: glTF prescribes metres and y up, yet many scans are z up in a .glb, and CAD models come in
millimetres. Geometry tells more: the smallest extent of an indoor scene is about a storey, and its floor is the
largest level surface near the bottom with headroom.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Float64

from anm_mj.scene.raster import Grid, areas, clip_to_slab, grid_over, level_mask, rasterise

UNITS = {1.0: "m", 0.01: "cm", 0.001: "mm"}
"""Metres per unit of the source, and the unit's name."""
_TYPICAL_HEIGHT_M = 2.8
_HEADROOM_M = 1.2
"""Headroom above a floor; tables, steps and undersides of slabs have less [m]."""
_FLOOR_ROUGHNESS_M = 0.05
"""Height above a level that still belongs to it: rugs, thresholds, scan noise [m]."""
_CELL_M = 0.1
_BIN_M = 0.02
_MAX_CELLS = 1_010_000
_FURNISHED_SHARE = 0.25
"""Where at least this share of a level has headroom, furniture stands on the rest."""
_OPEN_SHARE, _LEAST_ROOFED_M2 = 0.25, 4.0
"""A level with a roof over no more than this share is open ground; a building has a roof over at least so much [m2]."""
_MOST_LEVELS = 24
"""So many are looked at in a scene with open ground: each storey has four, the sides of its floor and its ceiling."""
_ROOF_M = 1.8
"""A level surface farther above a floor than this is a ceiling or a roof [m]."""
R_WORLD_SOURCE = {
    "z": np.eye(3),
    # +90 degrees about x: source y becomes world z.
    "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    # Cyclic: source x becomes world z.
    "x": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
}
"""Rotation from the source's axes, by the one that points up, to world axes with z up."""

Axis = Literal["x", "y", "z"]
_Triangles = Float[np.ndarray, "f 3 3"]
_Flat = Float[np.ndarray, "l 3 3"]


@dataclass(frozen=True)
class Level:
    """A horizontal surface."""

    z_m: float
    walkable_m2: float
    """Area with headroom [m2]."""
    area_m2: float
    """Area with and without headroom [m2]."""

    @property
    def floor_m2(self) -> float:
        """Area of a floor with its furniture, or the area with headroom of what is hardly a floor [m2]."""
        return self.area_m2 if self.walkable_m2 >= _FURNISHED_SHARE * self.area_m2 else self.walkable_m2


def find_scale(extents: Float[np.ndarray, "3"]) -> float:
    """Metres per unit: of m, cm and mm the one that brings the smallest extent closest to the height of a storey."""
    smallest = max(float(np.min(extents)), 1e-9)
    if smallest < 1e-6 * float(np.max(extents)):
        return 1.0
    return min(UNITS, key=lambda scale: abs(math.log(smallest * scale / _TYPICAL_HEIGHT_M)))


def find_up(triangles_m: _Triangles, usual: Axis, certainty: float = 1.25, among: str = "yz") -> Axis:
    """Up axis, of y, z (or others, ``among``) and the usual one: the axis along which the scene looks most like a
    storey with a floor.

    The score of an axis is the area of its floors, discounted by how far the extent along it is from the height of a
    storey. Another axis than ``usual`` must score ``certainty`` times as much.
    """
    axes: list[Axis] = [up for up in ("x", "y", "z") if up in among or up == usual]
    score = {up: _storey_score(triangles_m @ R_WORLD_SOURCE[up].T) for up in axes}
    best = max(axes, key=lambda up: score[up])
    return best if score[best] > certainty * score[usual] else usual


def _storey_score(triangles_m: _Triangles) -> float:
    """Area of the floors of all storeys [m2], discounted by unusual heights and by the root of the number of storeys.

    A building on its side has levels too, its walls, but they are smaller than floors, and there are more of them.
    Furniture counts as floor: bare walls would be larger than the floor between it.
    """
    found, top_m = _levels(triangles_m), float(triangles_m[:, :, 2].max())
    # The lowest surface is the underside of a slab as often as a floor, and no floor lies on it.
    lowest = next((k for k, level in enumerate(found) if level.floor_m2 > 0.0), 0)
    # What nothing rises above is a roof, or the outside of a wall of a building on its side.
    inside = [level for level in found[lowest + 1 :] if level.z_m < top_m - _HEADROOM_M]
    storeys = apart(sorted(found[lowest : lowest + 1] + inside, key=lambda level: -level.floor_m2), _HEADROOM_M)
    height_m = float(np.ptp(triangles_m[:, :, 2]))
    number = max(1, round(height_m / _TYPICAL_HEIGHT_M))
    ratio = max(height_m, 1e-9) / number / _TYPICAL_HEIGHT_M
    return sum(level.floor_m2 for level in storeys) * min(ratio, 1.0 / ratio) / math.sqrt(number)


def apart(found: Iterable[Level], least_m: float) -> list[Level]:
    """The levels that lie farther than ``least_m`` above or below all that are taken before them."""
    taken: list[Level] = []
    for level in found:
        if all(abs(level.z_m - other.z_m) > least_m for other in taken):
            taken.append(level)
    return taken


def find_floor(triangles_m: _Triangles, *, roofs: bool = False) -> Level | None:
    """The lowest of the large walkable levels of triangles with z up, or None when nothing is level.

    A level is large if it has at least half the area of the largest one. That excludes cellar slabs and undersides, and
    of two storeys it takes the lower one. Roofs and the tops of walls count only where there is little else, or with
    ``roofs``.
    """
    found_levels = _levels(triangles_m) if roofs else indoor_levels(triangles_m)
    if not found_levels:
        return None
    most = max(found.walkable_m2 for found in found_levels)
    # A bare roof is larger than what furniture leaves of the floor below it.
    below_m = math.inf if roofs else float(triangles_m[:, :, 2].max()) - _HEADROOM_M
    inside = [found for found in found_levels if found.z_m < below_m and found.walkable_m2 >= _FURNISHED_SHARE * most]
    found_levels = inside or found_levels
    most = max(found.walkable_m2 for found in found_levels)
    large = [found for found in found_levels if found.walkable_m2 >= 0.5 * most]
    # A thin floor slab has two large levels; the robot stands on the upper one.
    return [found for found in large if found.z_m <= large[0].z_m + _FLOOR_ROUGHNESS_M][-1]


def indoor_levels(triangles_m: _Triangles) -> list[Level]:
    """The largest levels from the lowest to the highest; where the largest lies mostly under the open sky, as the
    ground about a house does, the walkable area of all of them is what of it has a ceiling or a roof.
    """
    found = _levels(triangles_m)
    top_m = float(triangles_m[:, :, 2].max()) - _HEADROOM_M
    ground = max((level for level in found if level.z_m < top_m), key=lambda level: level.walkable_m2, default=None)
    if ground is None:
        return found
    flat = triangles_m[level_mask(triangles_m)]
    if _level_at(triangles_m, flat, ground.z_m, roofed=True).walkable_m2 > _OPEN_SHARE * ground.walkable_m2:
        return found
    # Floors of a house are small beside its garden.
    heights_m = _level_heights(flat, _LEAST_ROOFED_M2, _MOST_LEVELS)
    roofed = [_level_at(triangles_m, flat, z_m, roofed=True) for z_m in heights_m]
    return roofed if max(level.walkable_m2 for level in roofed) >= _LEAST_ROOFED_M2 else found


def _levels(triangles_m: _Triangles) -> list[Level]:
    flat = triangles_m[level_mask(triangles_m)]
    return [_level_at(triangles_m, flat, z_m) for z_m in _level_heights(flat)]


def _level_heights(flat: _Flat, least_m2: float = math.inf, most: int = 8) -> list[float]:
    """Heights of the largest surfaces of level triangles, from the lowest to the highest, at most so many [m].

    They have at least ``least_m2``, or 15 % of the area of the largest.
    """
    if not len(flat):
        return []
    z, area = flat[:, :, 2].mean(axis=1), areas(flat)
    low = float(z.min())
    histogram = np.bincount(((z - low) / _BIN_M).astype(np.int64), weights=area)
    # A level may straddle two bins.
    remaining = histogram + np.append(histogram[1:], 0.0)
    candidates = []
    least_m2 = min(least_m2, 0.15 * float(remaining.max()))
    while remaining.max() >= least_m2 and len(candidates) < most:
        peak = int(np.argmax(remaining))
        near = np.abs(z - (low + (peak + 1) * _BIN_M)) <= 1.5 * _BIN_M
        candidates.append(float(np.quantile(z[near], 0.5, weights=area[near], method="inverted_cdf")))
        remaining[max(0, peak - 2) : peak + 3] = 0.0
    return sorted(set(candidates))


def _level_at(triangles_m: _Triangles, flat: _Flat, z_m: float, *, roofed: bool = False) -> Level:
    """The level at a height; with ``roofed`` it is walkable only below a level surface more than 1.8 m above it."""
    ground = clip_to_slab(flat, z_m - _BIN_M, z_m + _BIN_M)
    if not len(ground):
        return Level(z_m, 0.0, 0.0)
    grid = _coarse_grid(ground)
    cells = rasterise(ground, grid)
    walkable = cells & ~rasterise(clip_to_slab(triangles_m, z_m + _FLOOR_ROUGHNESS_M, z_m + _HEADROOM_M), grid)
    if roofed:
        walkable &= _overhead(flat, z_m, grid)
    walkable_m2, area_m2 = (float(np.count_nonzero(own)) * grid.resolution_m**2 for own in (walkable, cells))
    return Level(z_m, walkable_m2, area_m2)


def _overhead(flat: _Flat, z_m: float, grid: Grid) -> Bool[np.ndarray, "rows cols"]:
    """Cells with a level surface higher than 1.8 m above a height."""
    low_m = z_m + _ROOF_M
    return rasterise(clip_to_slab(flat, low_m, max(low_m, float(flat[:, :, 2].max()))), grid)


def _coarse_grid(polygons_m: Float64[np.ndarray, "p k 2"]) -> Grid:
    """A grid of 10 cm over polygons, or a coarser one where that has more than a million cells."""
    size_m = np.ptp(polygons_m.reshape(-1, 2), axis=0)
    return grid_over(polygons_m, max(_CELL_M, math.sqrt(float(size_m.prod()) / _MAX_CELLS)))


def covered_share(triangles_m: _Triangles) -> float:
    """Share of the floor at z = 0 that has a level surface higher than 1.8 m above it (a ceiling, a roof)."""
    level = triangles_m[level_mask(triangles_m, 0.5)]
    floor = clip_to_slab(level, -_FLOOR_ROUGHNESS_M, _FLOOR_ROUGHNESS_M)
    if not len(floor):
        return 0.0
    grid = _coarse_grid(floor)
    ground = rasterise(floor, grid)
    return float(np.mean(_overhead(level, 0.0, grid)[ground]))
