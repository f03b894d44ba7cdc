"""Where free space ends: points on the borders between neighbouring cells, kept up by rows of the map."""

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int8
from scipy.spatial import KDTree

from anm_mj.frames import world_to_cell
from anm_mj.planning.distance_transform import capped_distance_cells
from anm_mj.types import FREE, UNKNOWN, TopDownMap, VoronoiGraph

BORDER_WIDTH_M = 0.15
"""A vertex borders on points that are up to this much farther away than its nearest border point [m]."""
_NEIGHBOURS = ((0, 1), (1, 0))
"""Row and column steps to the neighbours that borders are looked for towards."""


def borders_unknown(graph: VoronoiGraph, frontier_xy_m: Float[np.ndarray, "f 2"]) -> Bool[np.ndarray, " n"]:
    """Which vertices border on the unknown: it is about as near as the nearest obstacle."""
    distance = KDTree(frontier_xy_m).query(graph.vertex_xy_m)[0]
    return np.asarray(distance <= graph.clearance_m + BORDER_WIDTH_M)


def traversable_frontier(topdown: TopDownMap, radius_m: float) -> Float[np.ndarray, "f 2"]:
    """The border of the unknown where a disc of this radius fits into it; outside of the map is unknown [m]."""
    frontier = topdown.frontier_xy_m
    if not len(frontier):
        return frontier
    radius = radius_m / topdown.resolution_m
    pad = int(np.ceil(radius)) + 1
    unknown = np.pad(topdown.state == UNKNOWN, pad, constant_values=True)
    middle = capped_distance_cells(unknown, pad) >= radius
    # A border point lies on the edge of a cell, so that the disc's own rim is off by up to two cells.
    traversable = capped_distance_cells(~middle, pad + 2) <= radius + 1.5
    cell = world_to_cell(frontier, topdown.origin_xy_m, topdown.resolution_m) + pad
    cell = np.clip(cell, 0, np.array(traversable.shape) - 1)
    return frontier[traversable[cell[:, 0], cell[:, 1]]]


class BorderPoints:
    """Zero-crossings between free and occupied cells, and the middles between free and unknown ones.

    They are kept in the order of rows, so that those of rows where something has changed can be exchanged.
    """

    def __init__(self) -> None:
        self._shape: tuple[int, ...] = (0, 0)
        self._surface = [_Points() for _ in _NEIGHBOURS]
        self._frontier = [_Points() for _ in _NEIGHBOURS]

    @property
    def surface_cells(self) -> Float[np.ndarray, "s 2"]:
        """Zero-crossings between free and occupied: x, y from the corner of the map [cells]."""
        return np.concatenate([points.xy_cells for points in self._surface])

    @property
    def frontier_cells(self) -> Float[np.ndarray, "f 2"]:
        """Middles between free and unknown: x, y from the corner of the map [cells]."""
        return np.concatenate([points.xy_cells for points in self._frontier])

    def update(
        self, state: Int8[np.ndarray, "rows cols"], field_m: Float32[np.ndarray, "rows cols"], rows: slice
    ) -> None:
        """Look for the points of some rows again, in which cells have changed; of all rows where the map has grown.

        ``field_m`` is the signed distance to the surface, positive where free [m].
        """
        if state.shape != self._shape:
            self._shape, rows = state.shape, slice(0, len(state))
        # The last row before those that have changed borders on them.
        rows = slice(max(rows.start - 1, 0), rows.stop)
        free = state[rows.start : rows.stop + 1] == FREE
        for (d_row, d_col), surface, frontier in zip(_NEIGHBOURS, self._surface, self._frontier, strict=True):
            here, there = free[: len(free) - d_row, : free.shape[1] - d_col], free[d_row:, d_col:]
            row, col = np.divmod(np.flatnonzero((here != there)[: rows.stop - rows.start]), here.shape[1])
            row += rows.start
            at, beyond = (row, col), (row + d_row, col + d_col)
            unknown = (state[at] == UNKNOWN) | (state[beyond] == UNKNOWN)
            a, b = field_m[at], field_m[beyond]
            share = np.where(a * b < 0, a / np.where(a == b, np.float32(1.0), a - b), np.float32(0.5)).astype(float)
            share[unknown] = 0.5
            xy = np.stack([col + 0.5 + share * d_col, row + 0.5 + share * d_row], axis=1)
            surface.exchange(rows, row[~unknown], xy[~unknown])
            frontier.exchange(rows, row[unknown], xy[unknown])


class _Points:
    """Points by ascending row."""

    def __init__(self) -> None:
        self.row: Int[np.ndarray, " n"] = np.zeros(0, np.int64)
        self.xy_cells: Float[np.ndarray, "n 2"] = np.zeros((0, 2))

    def exchange(self, rows: slice, row: Int[np.ndarray, " m"], xy_cells: Float[np.ndarray, "m 2"]) -> None:
        """Take points in place of those in some rows."""
        first, last = np.searchsorted(self.row, [rows.start, rows.stop])
        self.row = np.concatenate([self.row[:first], row, self.row[last:]])
        self.xy_cells = np.concatenate([self.xy_cells[:first], xy_cells, self.xy_cells[last:]])
