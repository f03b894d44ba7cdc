"""Ways over a floor that is known, between places spread over it."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import distance_transform_edt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import KDTree

from anm_mj.evaluation.observable import ReachableArea

ROOM_M = 0.1
"""Ways keep this distance to the edge of the reachable floor where they can [m]."""
TIGHT_COST = 1.0
"""A metre of way at the very edge counts as so many more."""
LINK_SPACINGS = 3.2
"""Places so many spacings apart are linked directly, where the straight line is open."""
LINE_STEP_M = 0.05
"""Spacing of the points tested on a straight line [m], which keeps off the edge of the floor."""
AVOID_M = 0.25
"""Links that pass a spot which is to be avoided nearer than this are dearer [m]."""
AVOID_COST = 15.0
"""They count as so many times as long."""


class Ways:
    """Shortest ways between places.

    Args:
        floor: Where the robot's axis can get to.
        spacing_m: Of the places; one stands in every square of this size that holds reachable floor.
        more_m: Further places, as far as there is a way to them [m].
    """

    def __init__(self, floor: ReachableArea, spacing_m: float, more_m: Float[np.ndarray, "k 2"] | None = None) -> None:
        self._floor = floor
        edge_m = np.asarray(distance_transform_edt(np.pad(floor.reachable, 1)))[1:-1, 1:-1] * floor.resolution_m
        self._edge_m: Float[np.ndarray, "rows cols"] = edge_m
        """Distance from each cell's centre to the nearest that cannot be reached [m]."""
        cells = spread_places(floor.reachable, max(1, round(spacing_m / floor.resolution_m)), edge_m)
        places_m = np.concatenate([self._xy_m(cells), np.zeros((0, 2)) if more_m is None else more_m])
        links, _ = self._open_links(places_m, LINK_SPACINGS * spacing_m)
        _, part = connected_components(csr_array((np.ones(len(links)), links.T), shape=(len(places_m), len(places_m))))
        self.places_m: Float[np.ndarray, "p 2"] = places_m[part == np.bincount(part).argmax()]
        """World x, y of every place; there is a way from each to each."""
        self._links, room_m = self._open_links(self.places_m, LINK_SPACINGS * spacing_m)
        self._tree = KDTree(self.places_m)
        every = np.stack(np.meshgrid(*(np.arange(k) for k in edge_m.shape), indexing="ij"), axis=-1)
        self._nearest = np.asarray(self._tree.query(self._xy_m(every.reshape(-1, 2)))[1], np.int32)
        length_m = np.linalg.norm(self.places_m[self._links[:, 0]] - self.places_m[self._links[:, 1]], axis=1)
        tight = np.clip(1.0 - room_m / (ROOM_M + floor.resolution_m), 0.0, 1.0)
        self._cost = length_m * (1.0 + TIGHT_COST * tight) + 1e-6
        self._avoided = np.zeros(len(self._links), bool)
        self._search()

    def _search(self) -> None:
        n = len(self.places_m)
        a, b = self._links.T
        cost = np.where(self._avoided, AVOID_COST * self._cost, self._cost)
        graph = csr_array((cost, (a, b)), shape=(n, n))
        distance_m, before = dijkstra(graph, directed=False, return_predecessors=True)
        self.distance_m: Float[np.ndarray, "p p"] = distance_m
        """Length of the way from each place to each other, dearer along edges [m]."""
        self._before = before

    def _open_links(
        self, places_m: Float[np.ndarray, "p 2"], reach_m: float
    ) -> tuple[Int[np.ndarray, "k 2"], Float[np.ndarray, " k"]]:
        """Pairs of places near each other with an open line between them, and how much room it has [m]."""
        pairs = KDTree(places_m).query_pairs(reach_m, output_type="ndarray")
        is_open, room_m = self.open_lines(places_m[pairs[:, 0]], places_m[pairs[:, 1]])
        return pairs[is_open], room_m[is_open]

    def nearest(self, xy_m: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, " n"]:
        """The places nearest to others, good to a cell; those outside of the grid count as at its border."""
        col_row = np.floor((xy_m - self._floor.origin_xy_m) / self._floor.resolution_m).astype(np.int64)
        return self._nearest[np.ravel_multi_index((col_row[:, 1], col_row[:, 0]), self._edge_m.shape, mode="clip")]

    def near(self, radius_m: float) -> list[list[int]]:
        """For each place those within a radius, itself among them."""
        return [sorted(near) for near in self._tree.query_ball_point(self.places_m, radius_m)]

    def corners_m(self, a: int, b: int) -> Float[np.ndarray, "k 2"]:
        """The way from one place to another as few straight pieces: their ends, without the first [m]."""
        nodes = [b]
        while nodes[-1] != a:
            nodes.append(int(self._before[a, nodes[-1]]))
        xy_m = self.places_m[nodes[::-1]]
        return self.straightened(xy_m)[1:]

    def straightened(self, line_m: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "m 2"]:
        """A polyline without those corners that a straight line passes just as well [m]."""
        kept = [0]
        while kept[-1] < len(line_m) - 1:
            ahead = np.arange(kept[-1] + 1, len(line_m))
            is_open, _ = self.open_lines(np.broadcast_to(line_m[kept[-1]], (len(ahead), 2)), line_m[ahead])
            kept.append(int(ahead[is_open][-1]) if is_open.any() else int(ahead[0]))
        return line_m[kept]

    def open_lines(
        self, a_m: Float[np.ndarray, "n 2"], b_m: Float[np.ndarray, "n 2"]
    ) -> tuple[Bool[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Whether straight lines keep to the floor, with the room that their ends have, and how much room [m]."""
        if len(a_m) == 0:
            return np.zeros(0, bool), np.zeros(0)
        longest_m = float(np.linalg.norm(b_m - a_m, axis=1).max())
        share = np.linspace(0.0, 1.0, 2 + int(longest_m / LINE_STEP_M))[:, None, None]
        room_m = self.room_m(a_m + share * (b_m - a_m))
        wanted_m = np.minimum(np.minimum(room_m[0], room_m[-1]), ROOM_M) - self._floor.resolution_m
        least_m = room_m.min(axis=0)
        return least_m >= np.maximum(wanted_m, self._floor.resolution_m - 1e-9), least_m

    def room_m(self, xy_m: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n"]:
        """Distance from places to the edge of the reachable floor, good to a cell [m]; 0 beyond it."""
        col_row = np.floor((xy_m - self._floor.origin_xy_m) / self._floor.resolution_m).astype(np.int64)
        col, row = col_row[..., 0], col_row[..., 1]
        rows, cols = self._edge_m.shape
        inside = (row >= 0) & (col >= 0) & (row < rows) & (col < cols)
        return np.where(inside, self._edge_m[np.clip(row, 0, rows - 1), np.clip(col, 0, cols - 1)], 0.0)

    def least_room_m(self, xy_m: Float[np.ndarray, "2"], step_m: Float[np.ndarray, "2"], moves: int) -> float:
        """The least room on a line of moves [m]; every other is looked at, and the last."""
        resolution_m, edge_m = self._floor.resolution_m, self._edge_m
        x, y = ((xy_m - self._floor.origin_xy_m) / resolution_m).tolist()
        dx, dy = (step_m / resolution_m).tolist()
        rows, cols = edge_m.shape
        least_m = math.inf
        for k in [*range(2, moves, 2), moves]:
            row, col = math.floor(y + k * dy), math.floor(x + k * dx)
            if not (0 <= row < rows and 0 <= col < cols):
                return 0.0
            least_m = min(least_m, edge_m.item(row, col))
        return least_m

    def avoid(self, xy_m: Float[np.ndarray, "2"]) -> None:
        """Make the links about a spot dearer, so that ways lead round it."""
        a, b = self.places_m[self._links[:, 0]], self.places_m[self._links[:, 1]]
        along = b - a
        squared = np.maximum((along**2).sum(axis=1), 1e-12)
        share = np.clip(((xy_m - a) * along).sum(axis=1) / squared, 0.0, 1.0)
        away_m = np.linalg.norm(a + share[:, None] * along - xy_m, axis=1)
        self._avoided |= away_m < AVOID_M
        self._search()

    def _xy_m(self, cells: Int[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        return self._floor.origin_xy_m + (cells[:, ::-1] + 0.5) * self._floor.resolution_m


def num_places(floor: ReachableArea, spacing_m: float) -> int:
    """How many places there are at a spacing."""
    return len(spread_places(floor.reachable, max(1, round(spacing_m / floor.resolution_m)), floor.reachable * 1.0))


def spread_places(
    allowed: Bool[np.ndarray, "rows cols"], spacing_cells: int, room_m: Float[np.ndarray, "rows cols"]
) -> Int[np.ndarray, "n 2"]:
    """One cell out of every square block that holds an allowed one: the one with the most room about it."""
    rows, cols = np.nonzero(allowed)
    block = (rows // spacing_cells) * (allowed.shape[1] // spacing_cells + 1) + cols // spacing_cells
    order = np.lexsort((-room_m[rows, cols], block))
    first = order[np.unique(block[order], return_index=True)[1]]
    return np.stack([rows[first], cols[first]], axis=1)
