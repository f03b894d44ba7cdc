"""Connected components of anything that comes in pairs.

In C++ (``native/plane_maps.h``) where the engine was built, else by SciPy, which gives the same: its checks of a sparse
matrix take a hundred times as long as the search.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Int
from scipy.sparse import coo_matrix, csgraph

from anm_mj.utils.native_functions import native_function


def connected_components(links: Int[np.ndarray, "l 2"], num: int) -> Int[np.ndarray, " n"]:
    """The component of each of ``num`` nodes, by their first nodes; a node without links is a component of its own."""
    native = native_function("connected_components")
    if native is None:
        return scipy_connected_components(links, num)
    component = np.empty(num, np.int64)
    native(np.ascontiguousarray(links, np.int64), component)
    return component


def scipy_connected_components(links: Int[np.ndarray, "l 2"], num: int) -> Int[np.ndarray, " n"]:
    """The reference of :func:`connected_components`."""
    matrix = coo_matrix((np.ones(len(links), bool), (links[:, 0], links[:, 1])), shape=(num, num))
    return csgraph.connected_components(matrix, directed=False)[1].astype(np.int64)
