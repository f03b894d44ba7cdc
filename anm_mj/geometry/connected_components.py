"""Connected components of anything that comes in pairs."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int
from scipy.sparse import coo_matrix, csgraph


def connected_components(links: Int[np.ndarray, "l 2"], num: int) -> Int[np.ndarray, " n"]:
    """The component of each of ``num`` nodes; a node without links is a component of its own."""
    matrix = coo_matrix((np.ones(len(links), bool), (links[:, 0], links[:, 1])), shape=(num, num))
    return csgraph.connected_components(matrix, directed=False)[1].astype(np.int64)
