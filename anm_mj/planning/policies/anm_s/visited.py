"""Which places the robot was near to, and which vertices it need not visit because it saw what surrounds them.

A vertex of the graph is equidistant to the obstacles that surround it. Once the robot saw all of these from near
enough, and none of the border is unknown, a visit shows nothing new; regions of interest stand for the rest.
"""

import numpy as np
from jaxtyping import Bool, Float, Float32, Int
from scipy.spatial import KDTree

from anm_mj.frames import world_to_cell
from anm_mj.planning.borders import BORDER_WIDTH_M, borders_unknown
from anm_mj.planning.policies.anm_s.anm_s_config import AnmSConfig
from anm_mj.planning.policies.anm_s.region_stages import RegionState
from anm_mj.types import Footprint, OccupancyGrid

_AROUND = np.arange(-1, 2)
"""A cell and its neighbours along one axis."""


def seen_around(
    now: RegionState, vertices: Int[np.ndarray, " k"], grid: OccupancyGrid, footprint: Footprint, config: AnmSConfig
) -> Bool[np.ndarray, " k"]:
    """Whether the border around each of some vertices holds nothing unknown and was seen from near enough.

    Only the unknown that the robot fits into counts; the border must have been seen between the heights of the body.
    The grid tells from how near.
    """
    seen = np.zeros(len(vertices), bool)
    border, graph = now.topdown.surface_xy_m, now.graph
    if not len(border):
        return seen
    near = nearest_view_m(grid, footprint, border) <= config.seen_well_m
    closed = np.flatnonzero(~borders_unknown(graph, now.frontier_xy_m)[vertices])
    vertex = vertices[closed]
    reach_m = graph.clearance_m[vertex] + BORDER_WIDTH_M
    for i, around in zip(closed, KDTree(border).query_ball_point(graph.vertex_xy_m[vertex], reach_m), strict=True):
        seen[i] = len(around) > 0 and near[around].mean() >= config.seen_well_share
    return seen


def num_within(
    xy_m: Float[np.ndarray, "n 2"], places_xy_m: list[Float[np.ndarray, "2"]], radius_m: float
) -> Int[np.ndarray, " n"]:
    """How many of some places are nearer than ``radius_m`` to each point [m]."""
    if not places_xy_m:
        return np.zeros(len(xy_m), np.int64)
    # A tree, because the trajectory grows with every step. It includes points on the rim.
    near = KDTree(np.array(places_xy_m)).query_ball_point(xy_m, np.nextafter(radius_m, 0.0), return_length=True)
    return np.asarray(near, np.int64)


def nearest_view_m(
    grid: OccupancyGrid, footprint: Footprint, xy_m: Float[np.ndarray, "n 2"]
) -> Float32[np.ndarray, " n"]:
    """Smallest depth at which anything was seen in the columns about points, at body heights; +inf where never [m]."""
    body = grid.layers_between(footprint.z_min_m, footprint.z_max_m, whole=True)
    seen_m = grid.seen_range_m[body]
    _, rows, cols = seen_m.shape
    cell = np.clip(world_to_cell(xy_m, grid.origin_m[:2], grid.resolution_m), 0, [rows - 1, cols - 1])
    # A border point lies on the edge between two cells, and the surface may have been put into either.
    row = np.clip(cell[:, :1] + _AROUND, 0, rows - 1)
    col = np.clip(cell[:, 1:] + _AROUND, 0, cols - 1)
    cells = row[:, :, None] * cols + col[:, None, :]
    is_needed = np.zeros(rows * cols, bool)
    is_needed[cells] = True
    needed = np.flatnonzero(is_needed)
    depth = np.full(rows * cols, np.float32(np.inf))
    depth[needed] = seen_m.reshape(len(seen_m), -1)[:, needed].min(axis=0, initial=np.inf)
    return depth[cells].min(axis=(1, 2), initial=np.inf)
