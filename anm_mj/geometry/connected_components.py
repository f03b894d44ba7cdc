"""Connected components of anything that comes in pairs."""

import numpy as np
from jaxtyping import Int

from anm_mj import _native


def connected_components(links: Int[np.ndarray, "l 2"], num: int) -> Int[np.ndarray, " n"]:
    """The component of each of ``num`` nodes, by their first nodes; a node without links is a component of its own.
    Raises ValueError if a link names a node that is not there.
    """
    component = np.empty(num, np.int64)
    _native.connected_components(np.ascontiguousarray(links, np.int64), component)
    return component
