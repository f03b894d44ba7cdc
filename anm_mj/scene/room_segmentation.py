"""Room segmentation of a plan: rooms and the doors between them, from the walls.

Walls stand in a slice above most furniture and below lintels, and go on above: where they do in most places, what ends
between the two slices is furniture, and what begins there is a lintel. Shelves, posts and lamps that stand free part
nothing either. A watershed of the distance to walls and lintels splits the free floor into basins, which merge unless
what lies between them is a lintel or a door: at most ``DOOR_MAX_M`` wide and clearly narrower than both
(:mod:`anm_mj.geometry.room_merging`, as for the rooms of the robot's own graph).
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64, Int
from scipy import ndimage

from anm_mj.geometry.room_merging import merge_into_rooms
from anm_mj.scene.navigable import NavigableArea, floor_cells, pooled
from anm_mj.scene.raster import clip_to_slab, distance_cells, distance_in_walls, label_components, level_mask, rasterise

WALL_SLICE_M = (1.5, 1.9)
"""Heights of the slice of walls [m]."""
_LINTEL_SLICE_M = (2.15, 2.35)
"""Heights of the slice of walls and lintels, below most ceilings [m]."""
_HIGH_SHARE = 0.5
"""Where less of the walls goes on into that slice, they are too low to be told from furniture."""
_STEEP = 0.5
"""Walls and lintels have steep faces: |cos| of the angle between normal and z is at most this."""
_SHELF_M = (0.35, 2.0)
"""Smallest and largest depth of furniture that stands free; walls are thinner, shafts and closed rooms deeper [m]."""
_POST_M = 0.5
"""What stands free and is no longer than this parts nothing [m]."""
_MAX_CELLS = 3_000_000
"""Larger areas are divided on a coarser grid."""
DOOR_MAX_M = 1.6
"""Wider openings lie within one room [m]."""
_DOOR_MIN_M = 0.3
"""Narrower openings are slits [m]."""
_LINTEL_DOOR_M = 0.6
"""What lies below a lintel counts as an opening no wider than this [m]."""
_NARROWING = 0.8
"""A door is narrower than this share of the widest place of either room."""
MIN_ROOM_M2 = 1.5
"""Smaller areas are niches of their neighbour [m2]."""

_Mask = Bool[np.ndarray, "r c"]
_Labels = Int[np.ndarray, "r c"]
_Distances = Float64[np.ndarray, "r c"]


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
    walls, lintels = _walls_and_lintels(triangles_m, area)
    free = floor_cells(triangles_m, grid, closing_cells=4) & ~walls
    label, distance_m = segment_floor(free, cell_m, lintels)
    reached = np.bincount(label[area.component == 1], minlength=int(label.max()) + 1) > 0
    size_m2 = np.bincount(label.ravel()) * cell_m**2
    reached &= size_m2 >= MIN_ROOM_M2
    reached[0] = False
    order = [room for room in np.argsort(-size_m2, kind="stable").tolist() if reached[room]]
    number = np.zeros(len(size_m2), np.int64)
    number[order] = np.arange(1, len(order) + 1)
    room = number[label]
    return RoomPlan(room, tuple(size_m2[order].tolist()), _doors(room, distance_m, area))


def _walls_and_lintels(triangles_m: Float[np.ndarray, "f 3 3"], area: NavigableArea) -> tuple[_Mask, _Mask]:
    """Cells with a wall, and those with a lintel only."""
    steep = triangles_m[~level_mask(triangles_m, _STEEP)]
    # A wall shows as its two faces.
    low, high = (
        np.asarray(ndimage.binary_closing(rasterise(clip_to_slab(steep, *slab), area.grid), iterations=6), dtype=bool)
        for slab in (WALL_SLICE_M, _LINTEL_SLICE_M)
    )
    walls = low & np.asarray(ndimage.binary_dilation(high, iterations=2), dtype=bool)
    if np.count_nonzero(walls) < _HIGH_SHARE * np.count_nonzero(low):
        return low, np.zeros_like(low)
    kept = ~_standing_free(walls | high, area)
    return walls & kept, high & ~walls & kept


def _standing_free(walls: _Mask, area: NavigableArea) -> _Mask:
    """Cells of shelves, posts and the like: pieces as deep as furniture that no wall touches, and short ones."""
    cell_m = area.grid.resolution_m
    pieces, num = label_components(np.asarray(ndimage.binary_dilation(walls, iterations=2), dtype=bool), diagonal=True)
    sizes = np.bincount(pieces.ravel(), minlength=num + 1)
    free = np.zeros_like(walls)
    for number, box in enumerate(ndimage.find_objects(pieces), start=1):
        piece = pieces[box] == number
        if number == np.argmax(sizes[1:]) + 1:
            continue
        filled = np.asarray(ndimage.binary_fill_holes(piece), dtype=bool)
        short = max(piece.shape) * cell_m <= _POST_M + 4 * cell_m
        # The piece is two cells larger than what stands there.
        depth_m = 2.0 * cell_m * (distance_in_walls(filled) - 2.0)
        deep = depth_m >= _SHELF_M[0]
        around_deep = distance_cells(~deep) * cell_m <= _SHELF_M[0] / 2 + 2 * cell_m
        mostly_deep = deep.any() and np.count_nonzero(filled & around_deep) >= 0.5 * np.count_nonzero(filled)
        shelf = mostly_deep and depth_m.max() <= _SHELF_M[1]
        if short or (shelf and not (area.component[box][filled & ~piece] == 1).any()):
            free[box] |= piece
    return free & walls


def segment_floor(free: _Mask, cell_m: float, lintels: _Mask | None = None) -> tuple[_Labels, _Distances]:
    """Label every free cell (floor without walls; furniture is none) with its room, from 1; 0 elsewhere.

    Cells are ``cell_m`` wide [m]; what lies below ``lintels`` is a doorway however wide it is. Also the distance of
    each cell to the walls [m].
    """
    from skimage.segmentation import watershed

    lintels = np.zeros_like(free) if lintels is None else lintels & free
    # In metres and smoothed by half a cell: on the raw distances every second cell is a maximum of its own.
    parted, distance_m = (
        ndimage.gaussian_filter(distance_in_walls(cells) * cell_m, 0.7) for cells in (free & ~lintels, free)
    )
    # Too many tops do not matter: their basins merge.
    highest = np.asarray(ndimage.maximum_filter(parted, 5)) == parted
    tops, _ = label_components(highest & free & ~lintels, diagonal=True)
    basin = np.asarray(watershed(-parted, tops, mask=free & ~lintels))
    nearest = np.asarray(ndimage.distance_transform_edt(basin == 0, return_distances=False, return_indices=True))
    basin = np.where(lintels, basin[nearest[0], nearest[1]], basin)
    num = int(basin.max())
    below = np.where(lintels, np.minimum(distance_m, _LINTEL_DOOR_M / 2), distance_m)
    bottlenecks = sorted(_bottlenecks(basin, below).items())
    width_m = np.array([width for _, width in bottlenecks])
    room = merge_into_rooms(
        np.array([pair for pair, _ in bottlenecks], dtype=np.int64).reshape(-1, 2) - 1,
        width_m,
        2.0 * width_m <= DOOR_MAX_M,
        np.asarray(ndimage.maximum(parted, basin, index=np.arange(1, num + 1)), dtype=np.float64).reshape(-1),
        np.bincount(basin.ravel(), minlength=num + 1)[1:] * cell_m**2,
        _NARROWING,
        MIN_ROOM_M2,
    )
    return np.append(0, room + 1)[basin], distance_m


def _bottlenecks(label: _Labels, distance_m: _Distances) -> dict[tuple[int, int], float]:
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


def _doors(room: _Labels, distance_m: _Distances, area: NavigableArea) -> tuple[Door, ...]:
    """Every stretch of border between two rooms that is wide enough for a door."""
    doors = []
    boxes = ndimage.find_objects(room)
    for a, b in sorted(_bottlenecks(room, distance_m)):
        both = tuple(
            slice(max(0, max(s.start, t.start) - 3), min(s.stop, t.stop) + 3)
            for s, t in zip(boxes[a - 1], boxes[b - 1], strict=True)
        )
        near, far_m, fits = room[both], distance_m[both], area.component[both] > 0
        pieces, num = label_components(_beside(near == a, near == b))
        for piece in range(1, num + 1):
            cells = np.argwhere(pieces == piece)
            row, col = cells[np.argmax(far_m[cells[:, 0], cells[:, 1]])]
            # Distances are taken between centres of cells.
            width_m = 2.0 * float(far_m[row, col]) - area.grid.resolution_m
            if width_m >= _DOOR_MIN_M:
                centre = area.grid.centres_m(row + both[0].start, col + both[1].start)
                doors.append(Door(centre, width_m, (a, b), bool(fits[pieces == piece].any())))
    return tuple(doors)


def _beside(first: _Mask, second: _Mask) -> _Mask:
    """Cells of either set within two cells of the other."""
    grown = [np.asarray(ndimage.binary_dilation(cells, iterations=2), dtype=bool) for cells in (first, second)]
    return (first & grown[1]) | (second & grown[0])
