"""Regions of interest: uncertain surface, clustered by geometry and topology, anchored to vertices that can see it.

A surface point belongs to a region if it is more uncertain than most (paper, Eq. 4) and not known yet: it was seen only
from afar, or, as ``region_known_by`` says, the map expects it to be off by more than a few millimetres. It is anchored
to the nearest vertex that sees it: within range, not at a grazing angle, with nothing in between. Points form one
region if they are anchored to the same vertex and lie close together *in front of* the surface, so that the two sides
of a wall never join. Some surface always is the most uncertain, and noise on the decoders' weights (Eq. 4) does not
tell how often a place was observed; range and expected error do. A region vanishes once its surface is known, or once
the robot has turned to it at its anchor. So all regions vanish in the end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float32, Int
from scipy.spatial import KDTree

from anm_mj.geometry.connected_components import connected_components
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.types import OCCUPIED, OccupancyGrid, Region, SurfacePoints, VoronoiGraph

IN_FRONT_M = 0.25
"""Points are clustered this far in front of their surface [m]: more than half of any wall's thickness."""
PATCH_M = 0.25
"""Side of the cubes; the points of a cube are anchored and suppressed together [m]."""
RANGE_SHARE = 0.75
"""Surface that was seen only from farther away than this share of the camera's range may form regions."""
MAX_ANCHORS = 12
"""Nearest vertices tested as the anchor of a patch."""


class RegionFinder:
    """Remembers the uncertainty of the surface seen so far and finds regions in it."""

    def __init__(self, config: PlanningConfig):
        self.config = config
        self._points = SurfacePoints(
            np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32), np.zeros(0, np.float32)
        )
        self._error_m: Float32[np.ndarray, " n"] | None = None
        """Expected error of each point that observations can take away; None where the map does not tell."""
        self._observed: set[tuple[int, ...]] = set()
        """Cubes with suppressed patches."""
        self._cubes_of: dict[tuple[float, ...], list[tuple[int, ...]]] = {}
        """Cubes of each of the last regions, by its centre."""

    def update(
        self,
        surface: SurfacePoints,
        centre_xy_m: Float[np.ndarray, "2"],
        radius_m: float,
        error_m: Float32[np.ndarray, " n"] | None = None,
    ) -> None:
        """Replace the surface within ``radius_m`` of a place.

        ``error_m`` is the expected error of each point that observations can take away [m]; None where the map, now as
        always, does not tell.
        """
        old = self._points
        far = np.linalg.norm(old.xyz_m[:, :2] - centre_xy_m.astype(np.float32), axis=1) > radius_m
        low = surface.xyz_m[:, 2] <= self.config.region_max_height_m
        self._points = SurfacePoints(
            np.concatenate([old.xyz_m[far], surface.xyz_m[low]]),
            np.concatenate([old.normal[far], surface.normal[low]]),
            np.concatenate([old.uncertainty[far], surface.uncertainty[low]]),
        )
        if error_m is not None:
            before = np.zeros(0, np.float32) if self._error_m is None else self._error_m[far]
            self._error_m = np.concatenate([before, error_m[low]])

    def limit_range(self, range_m: float) -> None:
        """Anchor regions no farther away than the camera measures well [m]."""
        near_m = min(self.config.anchor_range_m, RANGE_SHARE * range_m)
        if near_m < self.config.anchor_range_m:
            self.config = replace(self.config, anchor_range_m=near_m)

    def mark_observed(self, region: Region) -> None:
        """Suppress a region from now on: the robot has turned to it at its anchor, and no view is better."""
        self._observed.update(self._cubes_of.get(tuple(region.centre_m.tolist()), ()))

    @property
    def observed(self) -> Int[np.ndarray, "n 3"]:
        """Cubes of suppressed patches, in whole edges."""
        return np.array(sorted(self._observed), np.int64).reshape(-1, 3)

    def continue_from(self, observed: Int[np.ndarray, "n 3"]) -> None:
        """Suppress what a prior run suppressed."""
        self._observed = {tuple(cube) for cube in observed.tolist()}

    def regions(
        self, graph: VoronoiGraph, grid: OccupancyGrid, camera_height_m: float, preferred: Int[np.ndarray, " v"]
    ) -> tuple[Region, ...]:
        """The regions that some vertex sees, most uncertain first.

        Regions are anchored to one of the ``preferred`` vertices if one sees them, else to others. Vertices look from
        ``camera_height_m`` [m]; the grid tells what stands between.
        """
        points, self._cubes_of = self._points, {}
        if not len(points.uncertainty) or not len(graph.vertex_xy_m):
            return ()
        median = max(float(np.median(points.uncertainty)), 1e-12)
        uncertain = points.uncertainty > np.percentile(points.uncertainty, self.config.region_percentile)
        if self._error_m is None:
            uncertain[uncertain] = _nearest_view_m(grid, points.xyz_m[uncertain]) > self.config.anchor_range_m
        else:
            uncertain &= self._error_m > self.config.region_error_m
        patches = _Patches.of(points.xyz_m[uncertain].astype(float), points.normal[uncertain].astype(float))
        unobserved = np.array([tuple(cube) not in self._observed for cube in patches.cube.tolist()], bool)
        anchor = np.full(len(patches.cube), -1, np.int64)
        for vertices in (preferred, np.setdiff1d(np.arange(len(graph.vertex_xy_m)), preferred)):
            left = np.flatnonzero((anchor < 0) & unobserved)
            anchor[left] = _anchors(patches, left, graph.vertex_xy_m, vertices, grid, camera_height_m, self.config)
        relative = points.uncertainty[uncertain] / median
        found = []
        for members in _clusters(patches, anchor, self.config.region_link_m):
            num_points = int(patches.num_points[members].sum())
            if num_points < self.config.region_min_members:
                continue
            middle = np.average(patches.xyz_m[members], axis=0, weights=patches.num_points[members])
            nearest = members[np.argmin(np.linalg.norm(patches.xyz_m[members] - middle, axis=1))]
            score = float(relative[np.isin(patches.patch_of, members)].mean())
            centre_m, normal = patches.xyz_m[nearest], patches.normal[nearest]
            found.append(Region(centre_m, normal, num_points, score, int(anchor[members[0]])))
            self._cubes_of[tuple(centre_m.tolist())] = [tuple(cube) for cube in patches.cube[members].tolist()]
        return tuple(sorted(found, key=lambda region: -region.score))


def _counts_and_strides(grid: OccupancyGrid) -> tuple[tuple[int, int], ...]:
    """Voxels along x, y and z, and how far apart neighbours lie in the raveled grid."""
    layers, rows, cols = grid.state.shape
    return (cols, 1), (rows, cols), (layers, rows * cols)


def _nearest_view_m(grid: OccupancyGrid, xyz_m: Float32[np.ndarray, "n 3"]) -> Float32[np.ndarray, " n"]:
    """Smallest depth at which the surface at points was seen [m]; +inf where never."""
    seen = grid.seen_range_m.reshape(-1)
    nearest = np.full(len(xyz_m), np.inf, np.float32)
    # The surface lies between voxel centres, and any voxel around it may hold the record.
    around = []
    for axis, (count, stride) in enumerate(_counts_and_strides(grid)):
        cell = np.floor((xyz_m[:, axis] - grid.origin_m[axis]) / grid.resolution_m).astype(np.int64)
        around.append([np.clip(cell + offset, 0, count - 1) * stride for offset in (-1, 0, 1)])
    for x, y, z in np.ndindex(3, 3, 3):
        np.minimum(nearest, seen[around[0][x] + around[1][y] + around[2][z]], out=nearest)
    return nearest


def line_of_sight(
    grid: OccupancyGrid, start_m: Float[np.ndarray, "n 3"], end_m: Float[np.ndarray, "n 3"]
) -> Bool[np.ndarray, " n"]:
    """Whether no occupied voxel lies between pairs of points, sampled once per voxel size."""
    longest = float(np.linalg.norm(end_m - start_m, axis=1).max(initial=0.0))
    share = np.linspace(0.0, 1.0, max(math.ceil(longest / grid.resolution_m), 1) + 1)
    flat, inside = np.zeros((len(start_m), len(share)), np.int64), np.ones((len(start_m), len(share)), bool)
    for axis, (count, stride) in enumerate(_counts_and_strides(grid)):
        along = start_m[:, axis, None] + (end_m - start_m)[:, axis, None] * share
        cell = np.floor((along - grid.origin_m[axis]) / grid.resolution_m).astype(np.int64)
        inside &= (cell >= 0) & (cell < count)
        flat += cell * stride
    flat[~inside] = 0
    occupied = (grid.state.reshape(-1)[flat] == OCCUPIED) & inside
    return ~occupied.any(axis=1)


@dataclass(frozen=True)
class _Patches:
    """Uncertain surface points, grouped by the cubes that contain the places in front of them."""

    xyz_m: Float[np.ndarray, "p 3"]
    normal: Float[np.ndarray, "p 3"]
    cube: Int[np.ndarray, "p 3"]
    num_points: Int[np.ndarray, " p"]
    patch_of: Int[np.ndarray, " n"]
    """Patch of each point."""

    @classmethod
    def of(cls, xyz_m: Float[np.ndarray, "n 3"], normal: Float[np.ndarray, "n 3"]) -> _Patches:
        """Patches of points with normals [m]."""
        cubes = np.floor((xyz_m + IN_FRONT_M * normal) / PATCH_M).astype(np.int64)
        cube, patch_of, size = np.unique(cubes, axis=0, return_inverse=True, return_counts=True)
        patch_of = patch_of.reshape(-1)
        mean = [np.bincount(patch_of, values[:, i], len(cube)) for values in (xyz_m, normal) for i in range(3)]
        middle = np.stack(mean[:3], axis=1) / size[:, None]
        direction = np.stack(mean[3:], axis=1)
        length = np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-9)
        return cls(middle, direction / length, cube, size, patch_of)


def _clusters(patches: _Patches, anchor: Int[np.ndarray, " p"], link_m: float) -> list[Int[np.ndarray, " k"]]:
    """Groups of patches that are connected in front of the surface and have the same anchor."""
    anchored = np.flatnonzero(anchor >= 0)
    if not len(anchored):
        return []
    in_front = patches.xyz_m[anchored] + IN_FRONT_M * patches.normal[anchored]
    pairs = KDTree(in_front).query_pairs(link_m, output_type="ndarray")
    pairs = pairs[anchor[anchored[pairs[:, 0]]] == anchor[anchored[pairs[:, 1]]]]
    label = connected_components(pairs, len(anchored))
    return [anchored[label == k] for k in range(int(label.max()) + 1)]


def _anchors(
    patches: _Patches,
    which: Int[np.ndarray, " n"],
    vertex_xy_m: Float[np.ndarray, "v 2"],
    vertices: Int[np.ndarray, " w"],
    grid: OccupancyGrid,
    camera_height_m: float,
    config: PlanningConfig,
) -> Int[np.ndarray, " n"]:
    """The nearest of some vertices that sees each of some patches; -1 where none does."""
    centre_m, normal = patches.xyz_m[which], patches.normal[which]
    anchor = np.full(len(centre_m), -1, np.int64)
    if not len(centre_m) or not len(vertices):
        return anchor
    k = min(MAX_ANCHORS, len(vertices))
    distance, rank_vertex = KDTree(vertex_xy_m[vertices]).query(
        centre_m[:, :2], k=k, distance_upper_bound=config.anchor_range_m
    )
    distance, rank_vertex = distance.reshape(len(centre_m), k), rank_vertex.reshape(len(centre_m), k)
    place, rank = np.nonzero(np.isfinite(distance))
    vertex = vertices[rank_vertex[place, rank]]
    eye = np.column_stack([vertex_xy_m[vertex], np.full(len(place), camera_height_m)])
    view, least = eye - centre_m[place], math.cos(math.radians(config.anchor_max_incidence_deg))
    frontal = (view * normal[place]).sum(axis=1) >= least * np.maximum(np.linalg.norm(view, axis=1), 1e-9)
    place, vertex, eye = place[frontal], vertex[frontal], eye[frontal]
    # The line of sight ends just in front of the surface: its own voxels would block it.
    visible = line_of_sight(grid, eye, centre_m[place] + 2 * grid.resolution_m * normal[place])
    # Ranks ascend within a place, so the nearest vertex is written last.
    anchor[place[visible][::-1]] = vertex[visible][::-1]
    return anchor
