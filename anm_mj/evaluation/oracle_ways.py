"""Ways over a floor that is known: how far it is from a place to all others, and along which line."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import distance_transform_edt
from skimage.graph import MCP_Geometric

from anm_mj.evaluation.observable import Floor

ROOM_M = 0.1
"""Ways keep this distance to the edge of the reachable floor where they can [m]."""
TIGHT_COST = 4.0
"""A metre right at the edge counts as so many more; a robot that follows a line cuts corners a little."""
AVOID_M = 0.25
"""Cells nearer than this to a place that is to be avoided are dearer [m]."""
AVOID_COST = 15.0
"""A metre right at such a place counts as so many more."""
LINE_STEP_M = 0.02
"""Spacing of the points tested on a straight line [m]."""


class Ways:
    """Shortest ways on a floor's cells.

    Args:
        floor: Where the robot's axis can get to.
    """

    def __init__(self, floor: Floor) -> None:
        self._floor = floor
        edge_m = np.asarray(distance_transform_edt(np.pad(floor.reachable, 1)))[1:-1, 1:-1] * floor.resolution_m
        self.edge_m: Float[np.ndarray, "rows cols"] = edge_m
        """Distance from each cell's centre to the nearest that cannot be reached [m]."""
        tight = np.clip(1.0 - edge_m / (ROOM_M + floor.resolution_m), 0.0, 1.0)
        self._cost = np.where(floor.reachable, 1.0 + TIGHT_COST * tight, np.inf)
        self._avoided = np.zeros(floor.reachable.shape)
        self._searches: dict[tuple[int, int], tuple[MCP_Geometric, Float[np.ndarray, "rows cols"]]] = {}

    def cell(self, xy_m: Float[np.ndarray, "2"]) -> tuple[int, int]:
        """Row and column of the reachable cell nearest to a place."""
        col, row = np.floor((xy_m - self._floor.origin_xy_m) / self._floor.resolution_m).astype(int)
        rows, cols = self._floor.reachable.shape
        if 0 <= row < rows and 0 <= col < cols and self._floor.reachable[row, col]:
            return int(row), int(col)
        found = np.argwhere(self._floor.reachable)
        return tuple(found[np.argmin(((found - (row, col)) ** 2).sum(axis=1))].tolist())

    def xy_m(self, cells: Int[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """World x, y of the centres of cells ``[row, col]`` [m]."""
        return self._floor.origin_xy_m + (cells[:, ::-1] + 0.5) * self._floor.resolution_m

    def distances_m(self, source: tuple[int, int], keep: bool = True) -> Float[np.ndarray, "rows cols"]:
        """Length of the way from a cell to all others, dearer along edges [m]; infinite where there is none."""
        return self._search(source, keep)[1]

    def path_m(self, source: tuple[int, int], target: tuple[int, int]) -> Float[np.ndarray, "k 2"]:
        """The way between two cells as few straight pieces: corners, the ends included [m]."""
        mcp, _ = self._search(target, True)
        cells = np.array(mcp.traceback(source))[::-1]
        corners = [0]
        while corners[-1] < len(cells) - 1:
            ahead = len(cells) - 1
            while ahead > corners[-1] + 1 and not self._is_open(cells[corners[-1]], cells[ahead]):
                ahead = corners[-1] + max(1, (ahead - corners[-1]) // 2)
            corners.append(ahead)
        return self.xy_m(cells[corners])

    def avoid(self, xy_m: Float[np.ndarray, "2"]) -> None:
        """Make the cells about a place dearer, the more the nearer."""
        rows, cols = np.indices(self._cost.shape)
        col, row = (xy_m - self._floor.origin_xy_m) / self._floor.resolution_m - 0.5
        away_m = np.hypot(rows - row, cols - col) * self._floor.resolution_m
        self._avoided = self._avoided + np.clip(1.0 - away_m / AVOID_M, 0.0, 1.0)
        self._searches.clear()

    def _search(self, source: tuple[int, int], keep: bool) -> tuple[MCP_Geometric, Float[np.ndarray, "rows cols"]]:
        if source not in self._searches:
            mcp = MCP_Geometric(self._cost + AVOID_COST * self._avoided, fully_connected=True)
            costs, _ = mcp.find_costs([source])
            found = (mcp, np.asarray(costs) * self._floor.resolution_m)
            if not keep:
                return found
            self._searches[source] = found
        return self._searches[source]

    def _is_open(self, a: Int[np.ndarray, "2"], b: Int[np.ndarray, "2"]) -> bool:
        """Whether the straight line between two cells keeps to the floor, with the room that its ends have."""
        count = 2 + int(np.linalg.norm(b - a) * self._floor.resolution_m / LINE_STEP_M)
        on_line = np.rint(np.linspace(a, b, count)).astype(int)
        room_m = min(ROOM_M, self.edge_m[tuple(a)], self.edge_m[tuple(b)])
        along_m = self.edge_m[tuple(on_line.T)]
        if self._avoided[tuple(on_line.T)].max() > max(self._avoided[tuple(a)], self._avoided[tuple(b)]) + 1e-9:
            return False
        return bool((along_m >= max(room_m - self._floor.resolution_m, self._floor.resolution_m)).all())


def spread_places(
    allowed: Bool[np.ndarray, "rows cols"], spacing_cells: int, room_m: Float[np.ndarray, "rows cols"]
) -> Int[np.ndarray, "n 2"]:
    """One cell out of every square block that holds an allowed one: the one with the most room about it."""
    rows, cols = np.nonzero(allowed)
    block = (rows // spacing_cells) * (allowed.shape[1] // spacing_cells + 1) + cols // spacing_cells
    order = np.lexsort((-room_m[rows, cols], block))
    first = order[np.unique(block[order], return_index=True)[1]]
    return np.stack([rows[first], cols[first]], axis=1)
