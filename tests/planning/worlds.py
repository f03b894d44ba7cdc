"""Analytic worlds: voxel grids of boxes, fully seen, and the exact SDF that goes with them."""

from __future__ import annotations

import numpy as np

from anm_mj.planning.field_of_view import FieldOfView
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.topdown_mapper import TopDownMapper
from anm_mj.planning.voronoi_graph import voronoi_graph
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, Footprint, MapUpdate, Observation, OccupancyGrid, Pose2, SurfacePoints

CAMERA = FieldOfView(tan_left=0.0, tan_right=0.0, tan_up=1e3, tan_down=1e3, pitch_rad=0.0, height_m=1.0)
"""Sees all heights everywhere ahead."""
RESOLUTION_M = 0.05
TRUNCATION_M = 0.1
HEIGHT_M = 2.0


class BoxWorld:
    """A map of axis-aligned boxes [x0, y0, x1, y1] from floor to ceiling, everything else seen free."""

    def __init__(self, size_m, boxes, unknown=()):
        cols, rows = (round(s / RESOLUTION_M) for s in size_m)
        layers = round(HEIGHT_M / RESOLUTION_M)
        state = np.full((layers, rows, cols), FREE, np.int8)
        for value, areas in ((UNKNOWN, unknown), (OCCUPIED, boxes)):
            for x0, y0, x1, y1 in areas:
                c0, r0, c1, r1 = (round(v / RESOLUTION_M) for v in (x0, y0, x1, y1))
                state[:, r0:r1, c0:c1] = value
        seen = np.where(state == OCCUPIED, np.float32(1.0), np.float32(np.inf))
        self.boxes = np.array(boxes, float).reshape(-1, 4)
        self.occupancy = OccupancyGrid(state, seen, np.zeros(3), RESOLUTION_M)
        self.truncation_m = TRUNCATION_M

    def integrate(self, observation: Observation) -> MapUpdate:
        return MapUpdate(0.0, 0, 0)

    def sdf(self, points_m):
        low, high = self.boxes[:, :2], self.boxes[:, 2:]
        centre, half = (low + high) / 2, (high - low) / 2
        q = np.abs(points_m[:, None, :2] - centre) - half
        outside = np.linalg.norm(np.maximum(q, 0), axis=-1)
        distance = (outside + np.minimum(q.max(axis=-1), 0)).min(axis=1)
        return np.clip(distance, -TRUNCATION_M, TRUNCATION_M).astype(np.float32)

    def uncertainty(self, points_m):
        return np.ones(len(points_m), np.float32)

    def occupancy_grid(self, centre_xy_m=None, radius_m=np.inf) -> OccupancyGrid:
        return self.occupancy

    def surface(self, centre_xy_m, radius_m, max_height_m=np.inf) -> SurfacePoints:
        return SurfacePoints(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32), np.zeros(0, np.float32))


def room(width_m, height_m, wall_m=0.2, boxes=(), unknown=()):
    """A closed room whose free inside is ``width_m`` by ``height_m``, its lower left inner corner at (wall, wall)."""
    w, h = width_m + 2 * wall_m, height_m + 2 * wall_m
    walls = [(0, 0, w, wall_m), (0, h - wall_m, w, h), (0, 0, wall_m, h), (w - wall_m, 0, w, h)]
    return BoxWorld((w, h), [*walls, *boxes], unknown)


def topdown_map(mapper, grid, sdf, pose, camera=CAMERA):
    """The top-down map that a mapper makes of an occupancy grid and a signed-distance function."""
    return mapper.update(grid, sdf, TRUNCATION_M, pose, camera)[0]


def see(world, x, y, safe_m=0.22):
    """The graph and the top-down map of a world, with everything in the local horizon of a robot at (x, y)."""
    config = PlanningConfig(horizon_m=100.0)
    topdown = topdown_map(
        TopDownMapper(config, Footprint(0.18, 0.05, 1.35)), world.occupancy, world.sdf, Pose2(x, y, 0.0)
    )
    return voronoi_graph(topdown, np.array([x, y], float), config, safe_m), topdown
