"""Triangles of a height range seen from above: exact clipped polygons, and the grid cells that they touch.

Clipping to the slab z_min..z_max leaves convex polygons of at most five corners. In each grid row a polygon covers one
run of cells, whose ends follow from its edges. No loop over triangles and no test per cell is needed.
"""

from dataclasses import dataclass
from typing import cast

import numpy as np
from jaxtyping import Bool, Float, Float64, Int
from numpy.typing import ArrayLike
from scipy import ndimage

_Cells = Int[np.ndarray, " n"]
_Mask = Bool[np.ndarray, "rows cols"]
_Triangles = Float[np.ndarray, "f 3 3"]


@dataclass(frozen=True)
class Grid:
    """Place of a grid in the world; cells are indexed ``[row, col]``, row along world y and col along world x."""

    origin_xy_m: Float64[np.ndarray, "2"]
    """World x, y of the outer corner of cell [0, 0]."""
    resolution_m: float
    rows: int
    cols: int

    def centres_m(self, rows: ArrayLike, cols: ArrayLike) -> Float64[np.ndarray, "*n 2"]:
        """World x, y of the centres of cells [m]; fractions of a cell are allowed."""
        return self.origin_xy_m + (np.stack([np.asarray(cols), np.asarray(rows)], axis=-1) + 0.5) * self.resolution_m


def grid_over(points_m: Float[np.ndarray, "*n d"], resolution_m: float, margin_m: float = 0.0) -> Grid:
    """A grid that covers the x, y of points, and a margin around them.

    Cell *centres* lie on multiples of the resolution: walls of man-made scenes stand at round numbers, and rounding
    does not move a surface in the middle of its cell to another cell.
    """
    corners = points_m.reshape(-1, points_m.shape[-1])[:, :2]
    low = np.floor((corners.min(axis=0).astype(np.float64) - margin_m) / resolution_m)
    high = np.ceil((corners.max(axis=0).astype(np.float64) + margin_m) / resolution_m)
    cols, rows = (high - low + 1).astype(int)
    return Grid((low - 0.5) * resolution_m, resolution_m, int(rows), int(cols))


def clip_to_slab(triangles_m: _Triangles, z_min_m: float, z_max_m: float) -> Float64[np.ndarray, "p 5 2"]:
    """The parts of triangles with z_min <= z <= z_max, as convex polygons in the plane [m].

    Triangles outside the slab are dropped. Polygons with fewer than five corners repeat the last one; vertical
    triangles give polygons without area.
    """
    z = triangles_m[:, :, 2]
    inside = triangles_m[(z.max(axis=1) >= z_min_m) & (z.min(axis=1) <= z_max_m)].astype(np.float64)
    z = inside[:, :, 2]
    whole = (z.min(axis=1) >= z_min_m) & (z.max(axis=1) <= z_max_m)
    cut = clip(clip(inside[~whole], z_min_m, 1.0), z_max_m, -1.0)
    polygons = np.concatenate([inside[whole][:, [0, 1, 2, 2, 2]], cut])
    return polygons[:, :, :2]


def clip(polygons: Float64[np.ndarray, "n k d"], bound_m: float, sign: float) -> Float64[np.ndarray, "n l d"]:
    """Convex polygons clipped to ``sign * (z - bound) >= 0`` (Sutherland-Hodgman); short ones repeat their last corner.

    A corner is x, y, z [m] and whatever else is linear over the polygon.
    """
    num, corners, size = polygons.shape
    height = sign * (polygons[:, :, 2] - bound_m)
    following = np.roll(polygons, -1, axis=1)
    height_following = np.roll(height, -1, axis=1)
    crossing = (height >= 0) != (height_following >= 0)
    share = np.divide(height, height - height_following, out=np.zeros_like(height), where=crossing)
    cuts = polygons + share[:, :, None] * (following - polygons)
    # Each corner may give itself and the cut of the edge behind it, in this order.
    points = np.stack([polygons, cuts], axis=2).reshape(num, 2 * corners, size)
    kept = np.stack([height >= 0, crossing], axis=2).reshape(num, 2 * corners)
    order = np.argsort(~kept, axis=1, kind="stable")[:, : corners + 1]
    # A polygon that merely touches the plane keeps at least one corner, so slot 0 is always valid.
    last = np.maximum(kept.sum(axis=1), 1) - 1
    slots = np.minimum(np.arange(corners + 1), last[:, None])
    chosen = np.take_along_axis(order, np.minimum(slots, corners), axis=1)
    return np.take_along_axis(points, chosen[:, :, None], axis=1)


def rasterise(polygons_m: Float64[np.ndarray, "p k 2"], grid: Grid) -> _Mask:
    """True for every cell of the grid that a convex polygon touches."""
    in_cells = (polygons_m - grid.origin_xy_m) / grid.resolution_m
    x, y = in_cells[:, :, 0], in_cells[:, :, 1]
    first_row, last_row = _cells(y.min(axis=1)), _cells(y.max(axis=1))
    flat = first_row == last_row
    low = first_row[flat], _cells(x[flat].min(axis=1)), _cells(x[flat].max(axis=1))
    tall = _row_runs(x[~flat], y[~flat], first_row[~flat], last_row[~flat])
    rows, first_col, last_col = (np.concatenate(pair) for pair in zip(low, tall, strict=True))
    return _fill_runs(rows, first_col, last_col, grid)


def _cells(coordinates: Float64[np.ndarray, " n"]) -> _Cells:
    return np.floor(coordinates).astype(np.int64)


def _row_runs(
    x: Float64[np.ndarray, "n k"], y: Float64[np.ndarray, "n k"], first_row: _Cells, last_row: _Cells
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row, first and last column of every run of cells that polygons of more than one row cover."""
    counts = last_row - first_row + 1
    which = np.repeat(np.arange(len(counts)), counts)
    rows = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts) + first_row[which]
    low, high = np.full(len(which), np.inf), np.full(len(which), -np.inf)
    for a in range(x.shape[1]):
        b = (a + 1) % x.shape[1]
        xa, ya = x[which, a], y[which, a]
        dx, dy = x[which, b] - xa, y[which, b] - ya
        # The piece of the edge within the row's strip, as shares of the edge; a level edge lies in the strip whole.
        level = dy == 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            bottom, top = (rows - ya) / dy, (rows + 1 - ya) / dy
        enter = np.where(level, 0.0, np.maximum(np.minimum(bottom, top), 0.0))
        leave = np.where(level, 1.0, np.minimum(np.maximum(bottom, top), 1.0))
        hit = (enter <= leave) & (~level | ((ya >= rows) & (ya <= rows + 1)))
        xa_in, xb_in = xa + enter * dx, xa + leave * dx
        np.minimum(low, np.minimum(xa_in, xb_in), out=low, where=hit)
        np.maximum(high, np.maximum(xa_in, xb_in), out=high, where=hit)
    found = low <= high
    return rows[found], _cells(low[found]), _cells(high[found])


def _fill_runs(rows: _Cells, first_col: _Cells, last_col: _Cells, grid: Grid) -> _Mask:
    """A grid with all runs set: +1 where one begins, -1 behind its end, summed along the rows."""
    inside = (rows >= 0) & (rows < grid.rows) & (last_col >= 0) & (first_col < grid.cols)
    rows = rows[inside]
    first = np.clip(first_col[inside], 0, grid.cols - 1)
    behind = np.clip(last_col[inside], 0, grid.cols - 1) + 1
    size, width = grid.rows * (grid.cols + 1), grid.cols + 1
    change = np.bincount(rows * width + first, minlength=size) - np.bincount(rows * width + behind, minlength=size)
    return np.cumsum(change.reshape(grid.rows, width), axis=1)[:, : grid.cols] > 0


def level_mask(triangles_m: _Triangles, min_cosine: float = 0.95) -> Bool[np.ndarray, " f"]:
    """True for level triangles, facing up or down: |cos| of the angle between normal and z is large enough."""
    normal = normals(triangles_m)
    return np.abs(normal[:, 2]) >= min_cosine * np.maximum(np.linalg.norm(normal, axis=1), 1e-30)


def areas(triangles_m: _Triangles) -> Float64[np.ndarray, " f"]:
    """Area of every triangle [m2]."""
    return 0.5 * np.linalg.norm(normals(triangles_m), axis=1)


def normals(triangles_m: _Triangles) -> Float64[np.ndarray, "f 3"]:
    """Normals of triangles; their length is twice the area."""
    corners = triangles_m.astype(np.float64)
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def distance_cells(free: _Mask) -> Float64[np.ndarray, "rows cols"]:
    """Distance from every free cell's centre to the nearest centre of a cell that is not free [cells]; infinite where
    all are free.
    """
    if free.all():
        # SciPy takes a place beside the grid for one that is not free.
        return np.full(free.shape, np.inf)
    return np.asarray(ndimage.distance_transform_edt(free), dtype=np.float64)


def distance_in_walls(free: _Mask) -> Float64[np.ndarray, "rows cols"]:
    """As :func:`distance_cells`, with walls all around the grid."""
    return distance_cells(np.pad(free, 1))[1:-1, 1:-1]


def border_labels(labels: Int[np.ndarray, "rows cols"]) -> Int[np.ndarray, " n"]:
    """The labels that touch the border of the grid."""
    return np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]]))


def label_components(cells: _Mask, *, diagonal: bool = False) -> tuple[Int[np.ndarray, "rows cols"], int]:
    """Number of the connected component of every set cell, from 1, and 0 elsewhere; and how many there are.

    Cells touch at edges, and with ``diagonal`` at corners as well.
    """
    return cast(tuple[np.ndarray, int], ndimage.label(cells, np.ones((3, 3)) if diagonal else None))
