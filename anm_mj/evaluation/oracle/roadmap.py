"""A roadmap of a known area: places spread over it, and shortest paths between them."""

import math

import numpy as np
from jaxtyping import Bool, Float, Int, Int32
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import KDTree

from anm_mj.frames import world_to_cell
from anm_mj.geometry.polyline import shortcut
from anm_mj.ground_truth.observable import ReachableArea
from anm_mj.utils.arrays import values_at

CLEARANCE_M = 0.1
"""Clearance that paths keep to the edge of the reachable area where they can [m]."""
CLEARANCE_COST = 1.0
"""Extra cost of a metre of path at the very edge [m]."""
EDGE_SPACINGS = 3.2
"""Places within this many spacings are joined by an edge if the straight segment is clear."""
SAMPLE_M = 0.05
"""Spacing of the points tested on a segment [m]."""
AVOID_M = 0.25
"""Edges nearer than this to a spot to avoid cost more [m]."""
AVOID_COST = 15.0
"""Cost factor of these edges."""


class Roadmap:
    """Places in an area and shortest paths between them. One stands in every square of ``spacing_m`` that holds
    reachable cells. Of ``more_m``, those that no path reaches are left out.
    """

    def __init__(self, area: ReachableArea, spacing_m: float, more_m: Float[np.ndarray, "k 2"] | None = None) -> None:
        clearance_m = area.clearance_m
        self.clearance_m: Float[np.ndarray, "rows cols"] = np.ascontiguousarray(clearance_m, np.float64)
        """Distance of each cell to the edge of the area [m]."""
        self.origin_xy_m: Float[np.ndarray, "2"] = area.origin_xy_m
        """Corner of the first cell [m]."""
        self.resolution_m = area.resolution_m
        """Edge of a cell [m]."""
        cells = spread_places(area, spacing_m)
        places_m = np.concatenate([area.cell_centres(cells), np.zeros((0, 2)) if more_m is None else more_m])
        edges, _ = self._clear_edges(places_m, EDGE_SPACINGS * spacing_m)
        _, part = connected_components(csr_array((np.ones(len(edges)), edges.T), shape=(len(places_m), len(places_m))))
        self.places_m: Float[np.ndarray, "p 2"] = places_m[part == np.bincount(part).argmax()]
        """World x, y of every place; all are connected."""
        self._edges, edge_clearance_m = self._clear_edges(self.places_m, EDGE_SPACINGS * spacing_m)
        self._tree = KDTree(self.places_m)
        every = np.stack(np.meshgrid(*(np.arange(k) for k in clearance_m.shape), indexing="ij"), axis=-1)
        self.nearest_place: Int32[np.ndarray, " cells"] = np.asarray(
            self._tree.query(area.cell_centres(every.reshape(-1, 2)))[1], np.int32
        )
        """The place nearest to each cell, row by row."""
        length_m = np.linalg.norm(self.places_m[self._edges[:, 0]] - self.places_m[self._edges[:, 1]], axis=1)
        lacking = np.clip(1.0 - edge_clearance_m / (CLEARANCE_M + area.resolution_m), 0.0, 1.0)
        self._cost_m = length_m * (1.0 + CLEARANCE_COST * lacking) + 1e-6
        self._avoided = np.zeros(len(self._edges), bool)
        self._search()

    def _search(self) -> None:
        n = len(self.places_m)
        a, b = self._edges.T
        cost_m = np.where(self._avoided, AVOID_COST * self._cost_m, self._cost_m)
        graph = csr_array((cost_m, (a, b)), shape=(n, n))
        distance_m, before = dijkstra(graph, directed=False, return_predecessors=True)
        self.distance_m: Float[np.ndarray, "p p"] = distance_m
        """Cost of the path from each place to each other: its length, more along edges of the area [m]."""
        self.before: Int32[np.ndarray, "p p"] = np.ascontiguousarray(before, np.int32)
        """The place before each other on the path from each place."""

    def _clear_edges(
        self, places_m: Float[np.ndarray, "p 2"], reach_m: float
    ) -> tuple[Int[np.ndarray, "k 2"], Float[np.ndarray, " k"]]:
        """Pairs of near places with a clear segment between them, and its clearance [m]."""
        pairs = KDTree(places_m).query_pairs(reach_m, output_type="ndarray")
        is_clear, clearance_m = self._segments_clear(places_m[pairs[:, 0]], places_m[pairs[:, 1]])
        return pairs[is_clear], clearance_m[is_clear]

    def nearest(self, xy_m: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, " n"]:
        """The place nearest to each point, good to a cell; points outside of the grid count as at its border."""
        row_col = world_to_cell(xy_m, self.origin_xy_m, self.resolution_m)
        return self.nearest_place[np.ravel_multi_index((*row_col.T,), self.clearance_m.shape, mode="clip")]

    def near(self, radius_m: float) -> list[list[int]]:
        """For each place the places within a radius, itself included."""
        return [sorted(near) for near in self._tree.query_ball_point(self.places_m, radius_m)]

    def path_m(self, a: int, b: int) -> Float[np.ndarray, "k 2"]:
        """Corners of the shortcut path from one place to another, without its start [m]."""
        nodes = [b]
        while nodes[-1] != a:
            nodes.append(int(self.before[a, nodes[-1]]))
        return self.shortcut_path(self.places_m[nodes[::-1]])[1:]

    def shortcut_path(self, points_m: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "m 2"]:
        """A polyline without the corners that a clear segment can skip [m]."""
        return shortcut(points_m, lambda a_m, b_m: self._segments_clear(a_m, b_m)[0])

    def _segments_clear(
        self, a_m: Float[np.ndarray, "n 2"], b_m: Float[np.ndarray, "n 2"]
    ) -> tuple[Bool[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Whether segments stay reachable with the clearance of their ends, and the least clearance of each [m]."""
        if len(a_m) == 0:
            return np.zeros(0, bool), np.zeros(0)
        longest_m = float(np.linalg.norm(b_m - a_m, axis=1).max())
        share = np.linspace(0.0, 1.0, 2 + int(longest_m / SAMPLE_M))[:, None, None]
        clearance_m = self._clearance_at(a_m + share * (b_m - a_m))
        resolution_m = self.resolution_m
        wanted_m = np.minimum(np.minimum(clearance_m[0], clearance_m[-1]), CLEARANCE_M) - resolution_m
        least_m = clearance_m.min(axis=0)
        return least_m >= np.maximum(wanted_m, resolution_m - 1e-9), least_m

    def _clearance_at(self, xy_m: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n"]:
        """Distance of points to the edge of the area, good to a cell [m]; 0 beyond it."""
        return values_at(self.clearance_m, world_to_cell(xy_m, self.origin_xy_m, self.resolution_m), 0.0)

    def least_clearance_m(self, xy_m: Float[np.ndarray, "2"], step_m: Float[np.ndarray, "2"], moves: int) -> float:
        """Least clearance on a straight row of moves, sampled at every other move and the last [m]."""
        resolution_m = self.resolution_m
        x, y = ((xy_m - self.origin_xy_m) / resolution_m).tolist()
        dx, dy = (step_m / resolution_m).tolist()
        rows, cols = self.clearance_m.shape
        least_m = math.inf
        for k in [*range(2, moves, 2), moves]:
            row, col = math.floor(y + k * dy), math.floor(x + k * dx)
            if not (0 <= row < rows and 0 <= col < cols):
                return 0.0
            least_m = min(least_m, self.clearance_m.item(row, col))
        return least_m

    def avoid(self, xy_m: Float[np.ndarray, "2"]) -> None:
        """Raise the cost of edges near a spot, so that paths lead round it."""
        a, b = self.places_m[self._edges[:, 0]], self.places_m[self._edges[:, 1]]
        along = b - a
        squared = np.maximum((along**2).sum(axis=1), 1e-12)
        share = np.clip(((xy_m - a) * along).sum(axis=1) / squared, 0.0, 1.0)
        away_m = np.linalg.norm(a + share[:, None] * along - xy_m, axis=1)
        self._avoided |= away_m < AVOID_M
        self._search()


def spread_places(area: ReachableArea, spacing_m: float) -> Int[np.ndarray, "n 2"]:
    """The cell [row, col] with the largest clearance of each square of a spacing that holds reachable cells."""
    side = max(1, round(spacing_m / area.resolution_m))
    rows, cols = np.nonzero(area.reachable)
    block = (rows // side) * (area.reachable.shape[1] // side + 1) + cols // side
    order = np.lexsort((-area.clearance_m[rows, cols], block))
    first = order[np.unique(block[order], return_index=True)[1]]
    return np.stack([rows[first], cols[first]], axis=1)
