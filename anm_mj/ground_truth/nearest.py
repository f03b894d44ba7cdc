"""How near points come to fixed places, exactly: the search behind completion and its rewards.

In C++ (``native/nearest.h``) where the native engine was built, else by SciPy's tree; both give the same distances to
the last bit.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import distance_transform_edt
from scipy.spatial import KDTree

from anm_mj.utils.native_functions import native_function
from anm_mj.utils.threads import usual_num_threads

GRID_CELL_M = 0.25
"""Cell of the pruning grid [m]; finer prunes more and costs more to fill."""
SEARCH_BOUNDS_M = (0.005, 0.01, 0.02, 0.05, 0.2, 1.0, np.inf)
"""Upper bounds of the present distances in each group of places [m]; the tree takes one bound per search."""
LEAF_SIZE = 40
"""Points per leaf of the tree; a tree serves few searches, so its construction counts as well."""
MANY_PLACES = 3000
"""From so many on a search is worth the start of threads."""
BOUND_SLACK = 1.0 + 1e-9
"""Relative slack of search bounds: the tree compares squares, and rounding must not hide a neighbour at the bound."""


class PruningGrid:
    """Lower bounds on the distances of fixed places to any cloud of points, from a coarse grid."""

    def __init__(self, places: Float[np.ndarray, "n 3"]) -> None:
        """Lay the grid about the places [m]."""
        self._low = places.min(axis=0)
        self._shape = tuple(np.floor((places.max(axis=0) - self._low) / GRID_CELL_M).astype(int) + 1)
        self.cell = self._cells(places)

    def _cells(self, points: Float[np.ndarray, "m 3"]) -> Int[np.ndarray, " m"]:
        # Moving a point to the grid's border brings it nearer to every place, so the bound stays a lower bound.
        index = np.floor((points - self._low) / GRID_CELL_M).astype(np.int64)
        return np.asarray(np.ravel_multi_index(tuple(index.T), self._shape, mode="clip"))

    def per_cell(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " cells"]:
        """Lower bound on the distance between anything in a cell and the points, for every cell [m]."""
        empty = np.ones(self._shape, dtype=bool)
        empty.ravel()[self._cells(points)] = False
        between_centres = distance_transform_edt(empty, sampling=GRID_CELL_M)
        return np.maximum(np.asarray(between_centres).ravel() - np.sqrt(3.0) * GRID_CELL_M, 0.0)


def spatial_order(places: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
    """An order in which places in a row are neighbours, so that the nodes of a tree stay in the processor's cache."""
    return np.argsort(PruningGrid(places).cell, kind="stable")


class ScipyNearest:
    """The reference.

    Points can only change places that lie nearer to them than their present distance. A coarse grid bounds that
    distance from below for all places at once, so only few need a search, and their present distance bounds it.
    """

    def __init__(self, places: Float[np.ndarray, "n 3"], num_threads: int | None = None) -> None:
        """Take the places; see :func:`nearest_search`."""
        self._places = places
        self._grid = PruningGrid(places)
        self._num_threads = num_threads

    def lower(self, distance_m: Float[np.ndarray, " n"], points: Float[np.ndarray, "m 3"]) -> None:
        """Replace the distance of every place by that to the nearest point, where that is less.

        Args:
            distance_m: of each place, changed in place; +inf where nothing is known [m].
            points: world [m].
        """
        if not len(points):
            return
        improvable = self._grid.per_cell(points)[self._grid.cell] < distance_m
        present_m = distance_m.copy()
        tree: KDTree | None = None
        lower_m = 0.0
        for upper_m in SEARCH_BOUNDS_M:
            group = np.flatnonzero(improvable & (present_m > lower_m) & (present_m <= upper_m))
            lower_m = upper_m
            if len(group) == 0:
                continue
            if tree is None:
                tree = KDTree(points, leafsize=LEAF_SIZE, balanced_tree=False, compact_nodes=False)
            # Places are searched one by one, so that the distances do not depend on the number of threads.
            threads = (self._num_threads or usual_num_threads()) if len(group) >= MANY_PLACES else 1
            found_m, _ = tree.query(self._places[group], distance_upper_bound=upper_m * BOUND_SLACK, workers=threads)
            distance_m[group] = np.minimum(present_m[group], found_m)


class NativeNearest:
    """The same in C++, in a fraction of the time: every place is searched within its own distance."""

    def __init__(self, places: Float[np.ndarray, "n 3"], num_threads: int | None = None) -> None:
        """Take the places; see :func:`nearest_search`."""
        function = native_function("lower_distances")
        assert function is not None  # Who chose it has looked.
        self._lower = function
        self._places = np.ascontiguousarray(places)
        self._num_threads = num_threads

    def lower(self, distance_m: Float[np.ndarray, " n"], points: Float[np.ndarray, "m 3"]) -> None:
        """Lower the distances; see the reference."""
        self._lower(np.ascontiguousarray(points), self._places, distance_m, self._num_threads or usual_num_threads())


def nearest_search(places: Float[np.ndarray, "n 3"], num_threads: int | None = None) -> ScipyNearest | NativeNearest:
    """The native search where it was built, else SciPy's.

    Args:
        places: world [m]; quickest where those in a row are neighbours.
        num_threads: threads to search with; None = as many as there are cores, or as ``OMP_NUM_THREADS`` says. The
            distances do not depend on it.
    """
    search = ScipyNearest if native_function("lower_distances") is None else NativeNearest
    return search(places, num_threads)
