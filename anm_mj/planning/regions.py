"""Regions of interest: uncertain surface, clustered by geometry and topology, anchored to vertices that can see it.

Surface points whose uncertainty stands out (paper, eq. 5, by default weighed by how well each place was seen) are
clustered where they lie close together *in front of* the surface, so that the two sides of a wall never join. Each
cluster is anchored to the nearest vertex that sees it: within range, not at a grazing angle, with nothing in between.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from anm_mj.planning.config import PlanningConfig
from anm_mj.types import OCCUPIED, Region, SurfacePoints, VoronoiGraph, VoxelGrid

IN_FRONT_M = 0.25
"""Points are clustered this far in front of their surface [m]: more than half of any wall's thickness."""
LOOKED_AT_CELL_M = 0.3
"""Size of the cells in which looked-at surface is remembered [m]."""
MAX_ANCHORS = 12
"""Nearest vertices that a region tries to be anchored to."""


class RegionFinder:
    """Remembers the uncertainty of surface seen so far and finds regions in it."""

    def __init__(self, config: PlanningConfig):
        """Start with no surface known."""
        self.config = config
        self._points = SurfacePoints(
            np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32), np.zeros(0, np.float32)
        )
        self._looked_at: set[tuple[int, int, int]] = set()

    def update(self, surface: SurfacePoints, centre_xy_m: Float[np.ndarray, 2], radius_m: float) -> None:
        """Replace what is remembered within ``radius_m`` of a place by ``surface``."""
        old = self._points
        far = np.linalg.norm(old.xyz_m[:, :2] - centre_xy_m.astype(np.float32), axis=1) > radius_m
        low = surface.xyz_m[:, 2] <= self.config.region_max_height_m
        self._points = SurfacePoints(
            np.concatenate([old.xyz_m[far], surface.xyz_m[low]]),
            np.concatenate([old.normal[far], surface.normal[low]]),
            np.concatenate([old.uncertainty[far], surface.uncertainty[low]]),
        )

    def mark_looked_at(self, region: Region) -> None:
        """Suppress a region from now on: the robot has turned to it from its anchor."""
        cell = np.floor(region.centre_m / LOOKED_AT_CELL_M).astype(int)
        for dz in (-1, 0, 1):
            for dy in (-1, 0, 1):
                for dx in (-1, 0, 1):
                    self._looked_at.add((int(cell[0]) + dx, int(cell[1]) + dy, int(cell[2]) + dz))

    def regions(
        self,
        graph: VoronoiGraph,
        grid: VoxelGrid,
        camera_height_m: float,
        vertices: Int[np.ndarray, " v"] | None = None,
    ) -> tuple[Region, ...]:
        """The regions that can be seen from some vertex, most uncertain first.

        Args:
            graph: the road map.
            grid: what may stand between a vertex and a region.
            camera_height_m: height that vertices look from [m].
            vertices: those that may be anchored to; None = all of them.
        """
        points = self._points
        if vertices is None:
            vertices = np.arange(len(graph.vertex_xy_m))
        if not len(points.uncertainty) or not len(vertices):
            return ()
        uncertain = points.uncertainty > np.percentile(points.uncertainty, self.config.region_percentile)
        if not uncertain.any():
            return ()
        median = max(float(np.median(points.uncertainty)), 1e-12)
        xyz, normal = points.xyz_m[uncertain].astype(float), points.normal[uncertain].astype(float)
        relative = points.uncertainty[uncertain] / median
        label = _clusters(xyz + IN_FRONT_M * normal, self.config.region_link_m)
        size = np.bincount(label)
        centre = np.stack([np.bincount(label, xyz[:, i]) / size for i in range(3)], axis=1)
        mean_normal = np.stack([np.bincount(label, normal[:, i]) for i in range(3)], axis=1)
        length = np.linalg.norm(mean_normal, axis=1, keepdims=True)
        mean_normal = np.divide(mean_normal, length, out=np.zeros_like(mean_normal), where=length > 1e-9)
        score = np.bincount(label, relative) / size
        kept = np.flatnonzero(size >= self.config.region_min_members)
        kept = np.array([k for k in kept if not self._is_looked_at(centre[k])], np.int64)
        vertex = _anchors(
            centre[kept], mean_normal[kept], graph.vertex_xy_m[vertices], grid, camera_height_m, self.config
        )
        found = [
            Region(centre[k], mean_normal[k], int(size[k]), float(score[k]), int(vertices[v]))
            for k, v in zip(kept, vertex, strict=True)
            if v >= 0
        ]
        return tuple(sorted(found, key=lambda region: -region.score))

    def _is_looked_at(self, centre_m: Float[np.ndarray, 3]) -> bool:
        return tuple(np.floor(centre_m / LOOKED_AT_CELL_M).astype(int).tolist()) in self._looked_at


def line_of_sight(
    grid: VoxelGrid, start_m: Float[np.ndarray, "n 3"], end_m: Float[np.ndarray, "n 3"]
) -> Bool[np.ndarray, " n"]:
    """Whether no occupied voxel lies between pairs of points, sampled once per voxel size."""
    longest = float(np.linalg.norm(end_m - start_m, axis=1).max(initial=0.0))
    share = np.linspace(0.0, 1.0, max(math.ceil(longest / grid.resolution_m), 1) + 1)
    xyz = start_m[:, None] + (end_m - start_m)[:, None] * share[None, :, None]
    cell = np.floor((xyz - grid.origin_m) / grid.resolution_m).astype(np.int64)[..., ::-1]
    inside = ((cell >= 0) & (cell < grid.state.shape)).all(axis=-1)
    cell = np.clip(cell, 0, np.array(grid.state.shape) - 1)
    occupied = (grid.state[cell[..., 0], cell[..., 1], cell[..., 2]] == OCCUPIED) & inside
    return ~occupied.any(axis=1)


def _clusters(points: Float[np.ndarray, "n 3"], link_m: float) -> Int[np.ndarray, " n"]:
    pairs = KDTree(points).query_pairs(link_m, output_type="ndarray")
    links = coo_matrix((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
    return connected_components(links, directed=False)[1]


def _anchors(
    centre_m: Float[np.ndarray, "n 3"],
    normal: Float[np.ndarray, "n 3"],
    vertex_xy_m: Float[np.ndarray, "v 2"],
    grid: VoxelGrid,
    camera_height_m: float,
    config: PlanningConfig,
) -> Int[np.ndarray, " n"]:
    """For each region the nearest vertex that sees it, -1 where none does."""
    if not len(centre_m):
        return np.zeros(0, np.int64)
    tree = KDTree(vertex_xy_m)
    k = min(MAX_ANCHORS, len(vertex_xy_m))
    distance, vertex = tree.query(centre_m[:, :2], k=k, distance_upper_bound=config.anchor_range_m)
    distance, vertex = distance.reshape(len(centre_m), k), vertex.reshape(len(centre_m), k)
    region, rank = np.nonzero(np.isfinite(distance))
    eye = np.column_stack([vertex_xy_m[vertex[region, rank]], np.full(len(region), camera_height_m)])
    # The sight ends just in front of the surface, whose own voxels would block it.
    seen = centre_m[region] + 2 * grid.resolution_m * normal[region]
    view = eye - centre_m[region]
    view /= np.maximum(np.linalg.norm(view, axis=1, keepdims=True), 1e-9)
    frontal = (view * normal[region]).sum(axis=1) >= math.cos(math.radians(config.anchor_max_incidence_deg))
    visible = frontal.copy()
    visible[frontal] = line_of_sight(grid, eye[frontal], seen[frontal])
    anchor = np.full(len(centre_m), -1, np.int64)
    for i, r in zip(region[visible][::-1], rank[visible][::-1], strict=True):
        anchor[i] = vertex[i, r]  # Ranks ascend within a region, so the nearest is written last.
    return anchor
