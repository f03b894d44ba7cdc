"""The frontier that the robot can go on into, and the vertices of the graph that border on it."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree

from anm_mj.frames import world_to_cell
from anm_mj.planning.distance_transform import capped_distance_cells
from anm_mj.types import UNKNOWN, TopDownMap, VoronoiGraph

BORDER_WIDTH_M = 0.15
"""A vertex borders on points that are up to this much farther away than its nearest border point [m]."""


def borders_unknown(graph: VoronoiGraph, frontier_xy_m: Float[np.ndarray, "f 2"]) -> Bool[np.ndarray, " n"]:
    """Which vertices border on the unknown: it is about as near as the nearest obstacle."""
    if not len(frontier_xy_m) or not len(graph.vertex_xy_m):
        return np.zeros(len(graph.vertex_xy_m), bool)
    distance = KDTree(frontier_xy_m).query(graph.vertex_xy_m)[0]
    return np.asarray(distance <= graph.clearance_m + BORDER_WIDTH_M)


def traversable_frontier(topdown: TopDownMap, radius_m: float) -> Float[np.ndarray, "f 2"]:
    """The border of the unknown where a disc of this radius fits into it; outside of the map is unknown [m]."""
    frontier = topdown.frontier_xy_m
    if not len(frontier):
        return frontier
    radius = radius_m / topdown.resolution_m
    pad = int(np.ceil(radius)) + 1
    unknown = np.pad(topdown.state == UNKNOWN, pad, constant_values=True)
    middle = capped_distance_cells(unknown, pad) >= radius
    # A border point lies on the edge of a cell, so that the disc's own rim is off by up to two cells.
    traversable = capped_distance_cells(~middle, pad + 2) <= radius + 1.5
    cell = world_to_cell(frontier, topdown.origin_xy_m, topdown.resolution_m) + pad
    cell = np.clip(cell, 0, np.array(traversable.shape) - 1)
    return frontier[traversable[cell[:, 0], cell[:, 1]]]
