"""How near points come to fixed places, exactly: the search behind completion and its rewards."""

import numpy as np
from jaxtyping import Float, Int

from anm_mj import _native
from anm_mj.utils.threads import usual_num_threads

_ORDER_CELL_M = 0.25


def spatial_order(places: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
    """An order in which places in a row are neighbours, so that the nodes of a tree stay in the processor's cache."""
    cell = np.floor((places - places.min(axis=0)) / _ORDER_CELL_M).astype(np.int64)
    return np.argsort(np.ravel_multi_index(tuple(cell.T), tuple(cell.max(axis=0) + 1)), kind="stable")


class NearestSearch:
    """Distances of fixed places to ever more points (``native/nearest.h``).

    Args:
        places: World [m]; quickest where those in a row are neighbours.
        num_threads: Threads to search with; None = as many as there are cores, or as ``OMP_NUM_THREADS`` says. The
            distances do not depend on it.
    """

    def __init__(self, places: Float[np.ndarray, "n 3"], num_threads: int | None = None) -> None:
        self._places = np.ascontiguousarray(places)
        self._num_threads = num_threads

    def lower(self, distance_m: Float[np.ndarray, " n"], points: Float[np.ndarray, "m 3"]) -> None:
        """Replace the distance of every place [m], +inf where unknown, by that to the nearest point if that is less."""
        threads = self._num_threads or usual_num_threads()
        _native.lower_distances(np.ascontiguousarray(points), self._places, distance_m, threads)
