"""The narrowest place of every edge of the graph, and the two points of the border that it lies between.

Both ends of an edge are as far from one generating point as from the other, so that the ends' clearances and the
length of the edge tell where these points are (paper, Eq. 3): at the same place along the edge, to either side of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from anm_mj.types import VoronoiGraph

SHORTEST_M = 1e-6
"""Shorter edges, between circles that are the same but for rounding, have no direction [m]."""


@dataclass(frozen=True)
class Bottlenecks:
    """What lies between the ends of the edges."""

    clearance_m: Float[np.ndarray, " e"]
    """Least along each edge, to the nearest border [m]."""
    xy_m: Float[np.ndarray, "e 2"]
    """Where that is [m]."""
    border_xy_m: Float[np.ndarray, "e 2 2"]
    """The points of the border that each edge is equidistant to, to its left and to its right [m]."""
    floor_m2: Float[np.ndarray, " e"]
    """Floor that an edge is the middle of, from border to border [m2]; exact between straight borders, up to twice as
    much where a corner or a pole juts out."""


def edge_bottlenecks(graph: VoronoiGraph) -> Bottlenecks:
    """The narrowest place of every edge, exact to rounding.

    Args:
        graph: the road map.
    """
    start, end = graph.vertex_xy_m[graph.edges[:, 0]], graph.vertex_xy_m[graph.edges[:, 1]]
    at_start, at_end = graph.clearance_m[graph.edges[:, 0]], graph.clearance_m[graph.edges[:, 1]]
    length = graph.edge_length_m
    some = np.maximum(length, SHORTEST_M)
    ahead = (end - start) / some[:, None]
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    # How far along the line through both ends the generating points lie, and how far off it.
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
