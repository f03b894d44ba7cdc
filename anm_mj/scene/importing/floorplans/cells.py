"""Rooms as labelled cells of a grid: their outlines, and the passages between them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from jaxtyping import Bool, Float64, Int
from scipy import ndimage

from anm_mj.scene.generation.building import Passage
from anm_mj.scene.raster import label_components

_BESIDE_M = 0.1
"""A passage reaches this far beyond the ends of its door's segment, where there is free floor [m]."""
_MIN_ROOM_CELLS = 40
_MAX_EXTENT_M = 500.0
"""Larger plans are mostly not in metres [m]."""
_MAX_CELLS = 8_000_000

_Labels = Int[np.ndarray, "rows cols"]


@dataclass(frozen=True, eq=False)
class CellPlan:
    """Floors as labelled cells, ``[row, col]`` with row along y and col along x."""

    labels: _Labels
    """Number of the room, from 0; -1 for walls and the outside."""
    origin_m: Float64[np.ndarray, "2"]
    """World x, y of the outer corner of cell [0, 0]."""
    cell_m: float

    def outlines(self) -> list[shapely.Polygon]:
        """Outline of every room."""
        return [self.outline(self.labels == label) for label in range(int(self.labels.max()) + 1)]

    def outline(self, cells: Bool[np.ndarray, "rows cols"]) -> shapely.Polygon:
        """Outline of 4-connected cells; cells that touch share their corners to the last bit."""
        padded = np.pad(cells, ((0, 0), (1, 1))).astype(np.int8)
        change = np.diff(padded, axis=1)
        rows, first = np.nonzero(change == 1)
        _, behind = np.nonzero(change == -1)
        merged = shapely.union_all(shapely.box(first, rows, behind, rows + 1)).simplify(0.0)
        if not isinstance(merged, shapely.Polygon):
            raise ValueError("a room falls into several pieces")
        # Whole numbers until here, so that the same corner of two rooms comes out the same.
        outer, *holes = (
            self.origin_m + np.asarray(ring.coords)[:, :2] * self.cell_m
            for ring in (merged.exterior, *merged.interiors)
        )
        return shapely.Polygon(outer, holes)


def grid_axes(
    bounds_m: Float64[np.ndarray, "4"], cell_m: float
) -> tuple[Float64[np.ndarray, "2"], Float64[np.ndarray, " cols"], Float64[np.ndarray, " rows"]]:
    """Outer corner, and x and y of the cells' centres, of a grid over x_min, y_min, x_max, y_max and a margin [m].
    Raises ValueError if the bounds are no building's.
    """
    low, high = bounds_m[:2], bounds_m[2:]
    if not np.isfinite(bounds_m).all() or (high - low).max() > _MAX_EXTENT_M:
        raise ValueError(f"a plan of {bounds_m.tolist()} m is larger than {_MAX_EXTENT_M:g} m")
    origin = np.floor(low / cell_m - 2.0) * cell_m
    cols, rows = np.ceil((high - origin) / cell_m).astype(int) + 2
    if cols * rows > _MAX_CELLS:
        raise ValueError(
            f"a plan of {high[0] - low[0]:.4g} m by {high[1] - low[1]:.4g} m is larger than "
            f"{_MAX_CELLS * cell_m**2:g} m2"
        )
    return origin, origin[0] + (np.arange(cols) + 0.5) * cell_m, origin[1] + (np.arange(rows) + 0.5) * cell_m


def cells_within(region: Any, xs: Float64[np.ndarray, " cols"], ys: Float64[np.ndarray, " rows"]) -> np.ndarray:
    """Whether the centre of each cell lies in a region of shapely: (rows, cols), of bool."""
    # Without this every point is held against every edge.
    shapely.prepare(region)
    return np.asarray(shapely.contains_xy(region, *np.meshgrid(xs, ys)), dtype=bool)


def fill_nearest(labels: _Labels, free: Bool[np.ndarray, "rows cols"]) -> _Labels:
    """Assign free cells without a room to the nearest room; other cells belong to none."""
    nearest = ndimage.distance_transform_edt(labels < 0, return_distances=False, return_indices=True)
    return np.where(free, labels[tuple(np.asarray(nearest))], -1)


def largest_parts(labels: _Labels) -> _Labels:
    """Every room reduced to its largest 4-connected part, under its old number."""
    kept = np.full_like(labels, -1)
    for label in range(int(labels.max()) + 1):
        parts, num = label_components(labels == label)
        if num:
            kept[parts == 1 + int(np.argmax(np.bincount(parts.ravel())[1:]))] = label
    return kept


def whole_rooms(labels: _Labels) -> _Labels:
    """The largest part of every room that is large enough, renumbered from 0."""
    kept = largest_parts(labels)
    large = np.bincount(kept[kept >= 0], minlength=int(labels.max()) + 1) >= _MIN_ROOM_CELLS
    # The last entry is for cells of no room, whose label is -1.
    return np.append(np.where(large, np.cumsum(large) - 1, -1), -1)[kept]


def take_passages(
    plan: CellPlan, doors_m: Float64[np.ndarray, "n 2 2"], depth_m: float
) -> tuple[CellPlan, list[Passage]]:
    """Cut the floor about every door's segment out of the rooms, which adjoin there, and make a passage of it.

    ``doors_m`` are both ends of every door's opening [m]; a passage is ``depth_m`` long, no more than the walls are
    thick [m]. Returns the rooms without the passages' floors, and the passages that join two rooms. Raises ValueError
    if a door is far from the rooms.
    """
    if not (np.abs(doors_m - plan.origin_m) < 2.0 * _MAX_EXTENT_M).all():
        raise ValueError(f"a door lies farther than {_MAX_EXTENT_M:g} m from the rooms")
    labels = plan.labels.copy()
    rows, cols = np.indices(labels.shape)
    centres = plan.origin_m + (np.stack([cols, rows], axis=-1) + 0.5) * plan.cell_m
    owner = np.full(labels.shape, -1)
    for index, (p, q) in enumerate(doors_m):
        length = float(np.linalg.norm(q - p))
        if length < 1e-6:
            continue
        along = (q - p) / length
        reach = length / 2 + depth_m + _BESIDE_M
        middle = np.floor(((p + q) / 2 - plan.origin_m) / plan.cell_m).astype(int)
        pad = int(reach / plan.cell_m) + 2
        part = tuple(slice(max(0, k - pad), k + pad + 1) for k in middle[::-1])
        away = centres[part] - p
        t, n = away @ along, away @ np.array([-along[1], along[0]])
        inside = (t > -_BESIDE_M) & (t < length + _BESIDE_M) & (np.abs(n) <= depth_m / 2) & (labels[part] >= 0)
        owner[part][inside] = index
    labels[owner >= 0] = -1
    # Passages may have cut corners off.
    labels = largest_parts(labels)
    rest = CellPlan(labels, plan.origin_m, plan.cell_m)
    passages = []
    for index in range(len(doors_m)):
        parts, num = label_components(owner == index)
        for number in range(1, num + 1):
            cells = parts == number
            beside = np.unique(labels[np.asarray(ndimage.binary_dilation(cells), dtype=bool) & (labels >= 0)])
            if len(beside) == 2:
                passages.append(Passage((int(beside[0]), int(beside[1])), rest.outline(cells)))
    return rest, passages
