"""Shortest paths over a grid map, for policies without a graph: Dijkstra over cells, then shortcuts."""

import numpy as np
from jaxtyping import Float
from skimage.graph import MCP_Geometric

from anm_mj.frames import cell_to_world, world_to_cell
from anm_mj.planning.paths import NEAR_ROBOT_M, shortcut_path
from anm_mj.types import FREE, Pose2, TopDownMap
from anm_mj.utils.arrays import values_at

COMFORT_M = 0.2
"""Paths prefer to keep this much clearance beyond the least one [m]."""


class GridRoutes:
    """The shortest paths from the robot to all cells of a map that it can reach."""

    def __init__(
        self,
        topdown: TopDownMap,
        pose: Pose2,
        safe_m: float,
        slack_m: float = 0.0,
        driven_xy_m: Float[np.ndarray, "n 2"] | None = None,
    ):
        """Search the whole map once.

        Args:
            topdown: the map; paths cross free cells only.
            pose: the robot's pose; within ``NEAR_ROBOT_M`` of it paths need no more clearance than it has now.
            safe_m: least clearance of a path [m].
            slack_m: so much less is enough at the centres of cells [m]: half a cell where clearance is that to
                surfaces, because another point of the cell may keep ``safe_m``.
            driven_xy_m: where the base was; free cells there need no clearance [m].
        """
        self.topdown = topdown
        self.pose = pose
        self.safe_m = safe_m
        clearance = topdown.clearance_m
        # A map of what a camera ahead has seen need not hold the base: its nearest cell stands for that then.
        start = world_to_cell(pose.xy_m[None], topdown.origin_xy_m, topdown.resolution_m)[0]
        start = start.clip(0, np.array(clearance.shape) - 1)
        rows, cols = np.ogrid[: clearance.shape[0], : clearance.shape[1]]
        near = np.hypot(rows - start[0], cols - start[1]) * topdown.resolution_m < NEAR_ROBOT_M
        least_m = safe_m - slack_m
        needed = np.where(near, min(least_m, float(clearance[tuple(start)])), least_m)
        passable = (clearance >= needed) & (topdown.state == FREE)
        if driven_xy_m is not None and len(driven_xy_m):
            driven = world_to_cell(driven_xy_m, topdown.origin_xy_m, topdown.resolution_m)
            driven = tuple(driven[((driven >= 0) & (driven < clearance.shape)).all(axis=1)].T)
            passable[driven] = topdown.state[driven] == FREE
        passable[tuple(start)] = True
        crowding = np.clip((safe_m + COMFORT_M - clearance) / COMFORT_M, 0.0, 1.0)
        self._search = MCP_Geometric(np.where(passable, 1.0 + crowding, -1.0))
        self.cost_cells = self._search.find_costs([tuple(start)])[0]
        """Cost of the path to each cell: its length, up to doubled near obstacles [cells]; +inf where none leads."""
        self._cells = np.argwhere(np.isfinite(self.cost_cells))
        self._xy_m = cell_to_world(self._cells, topdown.origin_xy_m, topdown.resolution_m)

    def nearest(self, xy_m: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
        """The reachable place nearest to another one in a straight line [m]."""
        return self._xy_m[np.argmin(np.linalg.norm(self._xy_m - xy_m, axis=1))]

    def cost_at(self, xy_m: Float[np.ndarray, "2"]) -> float:
        """Cost of the path to a place: its length, up to doubled near obstacles [m]; +inf where none leads."""
        cell = world_to_cell(xy_m, self.topdown.origin_xy_m, self.topdown.resolution_m)
        return float(values_at(self.cost_cells, cell, np.inf)) * self.topdown.resolution_m

    def path_to(self, xy_m: Float[np.ndarray, "2"]) -> Float[np.ndarray, "k 2"]:
        """Polyline from the robot to a place from :meth:`nearest`, or one of finite cost [m]."""
        end = world_to_cell(xy_m[None], self.topdown.origin_xy_m, self.topdown.resolution_m)[0]
        cells = np.array(self._search.traceback(tuple(end)))
        path = cell_to_world(cells, self.topdown.origin_xy_m, self.topdown.resolution_m)
        return shortcut_path(np.concatenate([self.pose.xy_m[None], path[1:]]), self.topdown, self.safe_m, self.pose)
