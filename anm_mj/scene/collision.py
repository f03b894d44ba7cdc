"""Collision geometry: merged boxes over the outline of everything at body height.

The robot is an upright cylinder that sweeps its full height, so a table blocks it as far as its outline reaches. One
slice through all body heights therefore suffices. The slice is taken from the exact triangles: convex hulls would
close doorways, and simplification would lose table legs.
"""

import math

import numpy as np
from jaxtyping import Bool, Float, Float64, Int
from scipy import ndimage

from anm_mj.scene.raster import (
    Grid,
    border_labels,
    clip_to_slab,
    distance_cells,
    grid_over,
    label_components,
    rasterise,
)

SLICE_Z_MIN_M = 0.05
"""Lower geometry (rugs, thresholds) passes below the shell of the robot [m]."""
SLICE_Z_MAX_M = 1.4
"""Higher geometry (lamps, lintels) is no obstacle; a little above the top of the robot [m]."""
RESOLUTION_M = 0.025
"""Cell size of the slice: half the thickness of common thin walls and table legs [m]."""
POCKET_RADIUS_M = 0.1
"""Enclosed free pockets too small for a disc of this radius are filled: a hollow wall becomes one box [m]."""

_MAX_CELLS = 8_000_000
"""Larger grids are worked through in tiles, of which only those that hold something cost anything."""
_TILE_M = 5.0


def collision_boxes(
    triangles_m: Float[np.ndarray, "f 3 3"], z_max_m: float = SLICE_Z_MAX_M
) -> Float64[np.ndarray, "n 4"]:
    """Rectangles x_min, y_min, x_max, y_max [m] that cover all triangles between SLICE_Z_MIN_M and a height.

    Surfaces become at most one cell too thick, never too thin.
    """
    polygons = clip_to_slab(triangles_m, SLICE_Z_MIN_M, z_max_m)
    if not len(polygons):
        return np.zeros((0, 4))
    grid = grid_over(polygons, RESOLUTION_M)
    if grid.rows * grid.cols > _MAX_CELLS:
        return _tiled_boxes(polygons)
    return _boxes_on(grid, polygons)


def _boxes_on(grid: Grid, polygons_m: Float64[np.ndarray, "p 5 2"]) -> Float64[np.ndarray, "n 4"]:
    occupied = fill_pockets(rasterise(polygons_m, grid), POCKET_RADIUS_M / RESOLUTION_M)
    return merge_cells(occupied, grid)


def _tiled_boxes(polygons_m: Float64[np.ndarray, "p 5 2"]) -> Float64[np.ndarray, "n 4"]:
    """The same rectangles tile by tile, where polygons lie far apart; pockets that reach beyond a tile stay open."""
    low, high = polygons_m.min(axis=1), polygons_m.max(axis=1)
    # Borders of tiles are borders of cells, so that no cell is covered twice.
    side = round(_TILE_M / RESOLUTION_M)
    first = np.floor((np.stack([low, high]) / RESOLUTION_M + 0.5) / side).astype(np.int64)
    boxes = []
    for row in range(int(first[0, :, 1].min()), int(first[1, :, 1].max()) + 1):
        in_row = np.flatnonzero((first[0, :, 1] <= row) & (first[1, :, 1] >= row))
        if not len(in_row):
            continue
        for col in range(int(first[0, in_row, 0].min()), int(first[1, in_row, 0].max()) + 1):
            own = in_row[(first[0, in_row, 0] <= col) & (first[1, in_row, 0] >= col)]
            if len(own):
                origin = (np.array([col, row]) * side - 0.5) * RESOLUTION_M
                boxes.append(_boxes_on(Grid(origin, RESOLUTION_M, side, side), polygons_m[own]))
    return np.concatenate(boxes)


def fill_pockets(occupied: Bool[np.ndarray, "rows cols"], radius_cells: float) -> Bool[np.ndarray, "rows cols"]:
    """The occupied cells, and all enclosed free pockets too small for a disc of the radius [cells]."""
    free, num = label_components(~occupied)
    if not num:
        return occupied
    enclosed = np.setdiff1d(np.arange(1, num + 1), border_labels(free))
    windows = ndimage.find_objects(free)
    margin = math.ceil(radius_cells) + 1
    pocket = np.zeros(num + 1, dtype=bool)
    for label in enclosed.tolist():
        # What is farther away than the radius does not count, so that a window about the pocket suffices.
        window = tuple(slice(max(0, part.start - margin), part.stop + margin) for part in windows[label - 1])
        distance = distance_cells(np.pad(~occupied[window], 1, constant_values=True))[1:-1, 1:-1]
        pocket[label] = float(distance[free[window] == label].max()) < radius_cells
    return occupied | pocket[free]


def merge_cells(occupied: Bool[np.ndarray, "rows cols"], grid: Grid) -> Float64[np.ndarray, "n 4"]:
    """Rectangles x_min, y_min, x_max, y_max [m] that cover exactly the occupied cells without overlap.

    Runs along one axis that continue unchanged in the next line are one rectangle; the axis with fewer wins.
    """
    by_row, by_col = _merge_runs(occupied), _merge_runs(occupied.T)[:, [1, 0, 3, 2]]
    rectangles = by_row if len(by_row) <= len(by_col) else by_col
    corner = np.tile(grid.origin_xy_m, 2)
    return corner + grid.resolution_m * rectangles[:, [1, 0, 3, 2]]


def _merge_runs(cells: Bool[np.ndarray, "lines places"]) -> Int[np.ndarray, "n 4"]:
    """First line, first place, behind the last line, behind the last place of maximal equal runs in adjacent lines."""
    padded = np.pad(cells, ((0, 0), (1, 1))).astype(np.int8)
    change = np.diff(padded, axis=1)
    lines, first = np.nonzero(change == 1)
    _, behind = np.nonzero(change == -1)
    order = np.lexsort((lines, behind, first))
    lines, first, behind = lines[order], first[order], behind[order]
    continues = (np.diff(first) == 0) & (np.diff(behind) == 0) & (np.diff(lines) == 1)
    starts = np.flatnonzero(np.concatenate([[True], ~continues]))[: len(lines)]
    ends = np.flatnonzero(np.concatenate([~continues, [True]]))[: len(lines)]
    return np.stack([lines[starts], first[starts], lines[ends] + 1, behind[starts]], axis=1)
