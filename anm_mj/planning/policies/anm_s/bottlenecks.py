"""Bottlenecks: the narrowest place of every edge of the graph, and the two border points to its sides.

Each end of an edge is equally far from both generating points (paper, Eq. 3). The clearances of the ends and the length
of the edge therefore determine these points: at the same place along the edge, one on each side.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from anm_mj.types import VoronoiGraph

SHORTEST_M = 1e-6
"""Shorter edges have no direction: their ends are the same but for rounding [m]."""


@dataclass(frozen=True)
class Bottlenecks:
    """The narrowest place of each edge."""

    clearance_m: Float[np.ndarray, " e"]
    """Least clearance along each edge [m]."""
    xy_m: Float[np.ndarray, "e 2"]
    """Where that is [m]."""
    border_xy_m: Float[np.ndarray, "e 2 2"]
    """The points of the border that each edge is equidistant to, to its left and to its right [m]."""
    floor_m2: Float[np.ndarray, " e"]
    """Area between each edge and the borders on both sides [m2]; exact between straight borders, up to twice as much at
    a corner or a pole."""


def edge_bottlenecks(graph: VoronoiGraph) -> Bottlenecks:
    """The bottlenecks of all edges of a graph, exact to rounding."""
    start, end = graph.vertex_xy_m[graph.edges[:, 0]], graph.vertex_xy_m[graph.edges[:, 1]]
    at_start, at_end = graph.clearance_m[graph.edges[:, 0]], graph.clearance_m[graph.edges[:, 1]]
    length = graph.edge_length_m
    some = np.maximum(length, SHORTEST_M)
    ahead = (end - start) / some[:, None]
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    # Distances of the generating points along the line through both ends, and from it.
    along = np.where(length > SHORTEST_M, (length**2 + at_start**2 - at_end**2) / (2.0 * some), 0.0)
    off = np.sqrt(np.maximum(at_start**2 - along**2, 0.0))
    between = np.clip(along, 0.0, length)
    abreast = start + along[:, None] * ahead
    aside = off[:, None] * left
    return Bottlenecks(
        np.hypot(off, along - between),
        start + between[:, None] * ahead,
        np.stack([abreast + aside, abreast - aside], axis=1),
        2.0 * length * off,
    )
