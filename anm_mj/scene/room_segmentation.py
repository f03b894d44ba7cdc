"""Room segmentation of a plan: rooms and the doors between them, from the walls.

A slice above furniture and below lintels shows little but walls. A watershed of the distance to the walls splits the
free floor into basins, which merge unless the bottleneck between them is a door: at most ``DOOR_MAX_M`` wide and
clearly narrower than both (:mod:`anm_mj.geometry.room_merging`, as for the rooms of the robot's own graph).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64, Int
from scipy import ndimage

from anm_mj.geometry.room_merging import merge_into_rooms
from anm_mj.scene.navigable import NavigableArea, floor_cells, pooled
from anm_mj.scene.raster import clip_to_slab, distance_in_walls, label_components, rasterise

WALL_SLICE_M = (1.5, 1.9)
"""Heights of the slice of walls [m]."""
_MAX_CELLS = 3_000_000
"""Larger areas are divided on a coarser grid."""
DOOR_MAX_M = 1.6
"""Wider openings lie within one room [m]."""
_DOOR_MIN_M = 0.3
"""Narrower openings are slits [m]."""
_NARROWING = 0.8
"""A door is narrower than this share of the widest place of either room."""
MIN_ROOM_M2 = 1.5
"""Smaller areas are niches of their neighbour [m2]."""


@dataclass(frozen=True, eq=False)
class Door:
    """A narrow passage between two rooms."""

    xy_m: Float64[np.ndarray, "2"]
    width_m: float
    """Width between the walls, exact to a cell [m]."""
    rooms: tuple[int, int]
    fits: bool


@dataclass(frozen=True, eq=False)
class RoomPlan:
    """Rooms on the grid of a navigable area."""

    room: Int[np.ndarray, "rows cols"]
    """Number of the room from 1, the largest first; 0 elsewhere."""
    area_m2: tuple[float, ...]
    """Floor of each room, furniture included [m2]."""
    doors: tuple[Door, ...]


def segment_rooms(triangles_m: Float[np.ndarray, "f 3 3"], area: NavigableArea) -> RoomPlan:
    """The rooms connected to most of the floor, and the doors between them."""
    coarser = math.ceil(math.sqrt(area.component.size / _MAX_CELLS))
    if coarser > 1:
        plan = segment_rooms(triangles_m, pooled(area, coarser))
        rows, cols = area.component.shape
        finer = np.repeat(np.repeat(plan.room, coarser, axis=0), coarser, axis=1)[:rows, :cols]
        return RoomPlan(finer, plan.area_m2, plan.doors)
    grid, cell_m = area.grid, area.grid.resolution_m
    walls = rasterise(clip_to_slab(triangles_m, *WALL_SLICE_M), grid)
    free = floor_cells(triangles_m, grid, closing_cells=4) & ~walls
    label, distance_m = segment_floor(free, cell_m)
    reached = np.bincount(label[area.component == 1], minlength=int(label.max()) + 1) > 0
    size_m2 = np.bincount(label.ravel()) * cell_m**2
    reached &= size_m2 >= MIN_ROOM_M2
    reached[0] = False
    order = [room for room in np.argsort(-size_m2, kind="stable").tolist() if reached[room]]
    number = np.zeros(len(size_m2), np.int64)
    number[order] = np.arange(1, len(order) + 1)
    room = number[label]
    return RoomPlan(room, tuple(size_m2[order].tolist()), _doors(room, distance_m, area))


def segment_floor(
    free: Bool[np.ndarray, "r c"], cell_m: float
) -> tuple[Int[np.ndarray, "r c"], Float64[np.ndarray, "r c"]]:
    """Label every free cell (floor without walls; furniture is none) with its room, from 1; 0 elsewhere.

    Cells are ``cell_m`` wide [m]. Also the distance of each cell to the walls [m].
    """
    from skimage.morphology import h_maxima
    from skimage.segmentation import watershed

    # In metres and smoothed by half a cell: on the raw distances every second cell is a maximum of its own.
    distance_m = ndimage.gaussian_filter(distance_in_walls(free) * cell_m, 0.7)
    tops, _ = label_components(np.asarray(h_maxima(distance_m, 2 * cell_m), dtype=bool))
    basin = np.asarray(watershed(-distance_m, tops, mask=free))
    num = int(basin.max())
    bottlenecks = sorted(_bottlenecks(basin, distance_m).items())
    width_m = np.array([width for _, width in bottlenecks])
    room = merge_into_rooms(
        np.array([pair for pair, _ in bottlenecks], dtype=np.int64).reshape(-1, 2) - 1,
        width_m,
        2.0 * width_m <= DOOR_MAX_M,
        np.asarray(ndimage.maximum(distance_m, basin, index=np.arange(1, num + 1)), dtype=np.float64).reshape(-1),
        np.bincount(basin.ravel(), minlength=num + 1)[1:] * cell_m**2,
        _NARROWING,
        MIN_ROOM_M2,
    )
    return np.append(0, room + 1)[basin], distance_m


def _bottlenecks(label: Int[np.ndarray, "r c"], distance_m: Float64[np.ndarray, "r c"]) -> dict[tuple[int, int], float]:
    """The widest place of the border between every two labels that touch: its distance to the walls [m]."""
    bottlenecks: dict[tuple[int, int], float] = {}
    for a, b, da, db in (
        (label[1:], label[:-1], distance_m[1:], distance_m[:-1]),
        (label[:, 1:], label[:, :-1], distance_m[:, 1:], distance_m[:, :-1]),
    ):
        touch = (a != b) & (a > 0) & (b > 0)
        widths = np.minimum(da[touch], db[touch])
        pairs = np.sort(np.stack([a[touch], b[touch]], axis=1), axis=1)
        for pair, width in zip(map(tuple, pairs.tolist()), widths.tolist(), strict=True):
            bottlenecks[pair] = max(bottlenecks.get(pair, 0.0), width)
    return bottlenecks


def _doors(
    room: Int[np.ndarray, "r c"], distance_m: Float64[np.ndarray, "r c"], area: NavigableArea
) -> tuple[Door, ...]:
    """Every stretch of border between two rooms that is wide enough for a door."""
    doors = []
    for a, b in sorted(_bottlenecks(room, distance_m)):
        pieces, num = label_components(_beside(room == a, room == b))
        for piece in range(1, num + 1):
            cells = np.argwhere(pieces == piece)
            row, col = cells[np.argmax(distance_m[cells[:, 0], cells[:, 1]])]
            # Distances are taken between centres of cells.
            width_m = 2.0 * float(distance_m[row, col]) - area.grid.resolution_m
            if width_m >= _DOOR_MIN_M:
                fits = bool((area.component[pieces == piece] > 0).any())
                doors.append(Door(area.grid.centres_m(row, col), width_m, (a, b), fits))
    return tuple(doors)


def _beside(first: Bool[np.ndarray, "r c"], second: Bool[np.ndarray, "r c"]) -> Bool[np.ndarray, "r c"]:
    """Cells of either set within two cells of the other."""
    grown = [np.asarray(ndimage.binary_dilation(cells, iterations=2), dtype=bool) for cells in (first, second)]
    return (first & grown[1]) | (second & grown[0])
