"""The map that a robot moving in the plane needs: what its body would touch, what it would not, what nobody knows.

A column of the occupancy grid over the body's heights is occupied where anything was hit, free where enough of it was
seen through, unknown elsewhere. Near surfaces the neural map sharpens it: the minimum of the SDF over the heights
(paper, footnote 1) says where within a cell the surface lies. A sign that the field only extrapolates never opens a
way: the SDF is asked next to observed surface alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float, Float32, Int8
from scipy import ndimage

from anm_mj.planning.config import PlanningConfig
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, Footprint, Pose2, TopDownMap, VoxelGrid

TRUNCATION_M = 0.1
"""Beyond this distance the SDF says no more than 'far' [m]."""

BLOCKED_CELLS = 2
"""Radius of the obstacle that a refused step leaves in the map [cells]."""

SdfQuery = Callable[[Float[np.ndarray, "n 3"]], Float32[np.ndarray, " n"]]


class TopDownMapper:
    """Keeps the top-down map up: columns from occupancy, minimum SDF near surfaces, asked anew inside the horizon."""

    def __init__(self, config: PlanningConfig, footprint: Footprint):
        """Start with an empty map.

        Args:
            config: the planner's settings.
            footprint: the body whose heights decide.
        """
        self.config = config
        self.footprint = footprint
        self.trail_xy_m: list[Float[np.ndarray, 2]] = []
        """Where the robot has been [m]."""
        self._new_trail_xy_m: list[Float[np.ndarray, 2]] = []
        self._new_blocked_xy_m: list[Float[np.ndarray, 2]] = []
        self._origin_xy_m = np.zeros(2)
        self._min_sdf_m = np.zeros((0, 0), np.float32)
        self._near_trail = np.zeros((0, 0), bool)
        self._under_robot = np.zeros((0, 0), bool)
        self._blocked = np.zeros((0, 0), bool)

    def add_blocked(self, xy_m: Float[np.ndarray, 2]) -> None:
        """Remember a place where the robot met something the map does not show [m]."""
        self._new_blocked_xy_m.append(xy_m)

    def visit(self, xy_m: Float[np.ndarray, 2]) -> None:
        """Take in that the robot has been somewhere: the floor there is free [m]."""
        self.trail_xy_m.append(xy_m)
        self._new_trail_xy_m.append(xy_m)

    def update(self, grid: VoxelGrid, sdf: SdfQuery, pose: Pose2) -> TopDownMap:
        """The map as known now.

        Args:
            grid: the occupancy.
            sdf: metric SDF of world points (N, 3), truncated at ``TRUNCATION_M``.
            pose: where the robot stands: the centre of the horizon, and proof that the floor there is free.
        """
        self.visit(pose.xy_m)
        self._follow_growth(grid)
        self._stamp(grid)
        state = self._columns(grid)
        self._ask_sdf(grid, state, sdf, pose)
        field = np.where(state == OCCUPIED, np.float32(-TRUNCATION_M / 2), np.float32(TRUNCATION_M))
        field = np.minimum(field, self._min_sdf_m)
        # A body has stood here: whatever voxels and field say, the floor was passable.
        field[self._under_robot], state[self._under_robot] = TRUNCATION_M, FREE
        field[self._blocked], state[self._blocked] = -TRUNCATION_M / 2, OCCUPIED
        state[(field <= 0) & (state == FREE)] = OCCUPIED
        free = state == FREE
        resolution = grid.resolution_m
        clearance = _signed_distance(free) * np.float32(resolution)
        origin = grid.origin_m[:2].astype(float)
        return TopDownMap(
            clearance,
            state,
            resolution,
            origin,
            surface_xy_m=_crossings(field, free, state == OCCUPIED, origin, resolution),
            frontier_xy_m=_crossings(None, free, state == UNKNOWN, origin, resolution),
        )

    def _columns(self, grid: VoxelGrid) -> Int8[np.ndarray, "rows cols"]:
        z0, z1 = (
            math.ceil((z - grid.origin_m[2]) / grid.resolution_m - 1e-6)
            for z in (self.footprint.z_min_m, self.footprint.z_max_m)
        )
        body = grid.state[max(z0, 0) : max(z1, 0)]
        num_free = np.count_nonzero(body == FREE, axis=0)
        state = np.where(num_free >= self.config.free_share * max(z1 - z0, 1), np.int8(FREE), np.int8(UNKNOWN))
        state[_enclosed_holes(state == UNKNOWN, self.config.hole_area_m2 / grid.resolution_m**2)] = FREE
        state[self._near_trail] = FREE
        state[(body == OCCUPIED).any(axis=0)] = OCCUPIED
        return state

    def _stamp(self, grid: VoxelGrid) -> None:
        """Draw new places of the trail and new obstacles into their layers."""
        body, cell = self.footprint.radius_m, grid.resolution_m
        for xy in self._new_trail_xy_m:
            first = xy is self.trail_xy_m[0]
            _stamp_disc(self._near_trail, grid, xy, max(body, self.config.start_radius_m) if first else body)
            _stamp_disc(self._under_robot, grid, xy, body - cell)
        for xy in self._new_blocked_xy_m:
            _stamp_disc(self._blocked, grid, xy, BLOCKED_CELLS * cell)
        self._new_trail_xy_m, self._new_blocked_xy_m = [], []

    def _follow_growth(self, grid: VoxelGrid) -> None:
        """Keep what is remembered aligned with a grid that has grown."""
        shape = grid.state.shape[1:]
        if self._min_sdf_m.shape == shape and np.allclose(self._origin_xy_m, grid.origin_m[:2]):
            return
        col, row = np.rint((self._origin_xy_m - grid.origin_m[:2]) / grid.resolution_m).astype(int)
        rows, cols = row + len(self._min_sdf_m), col + self._min_sdf_m.shape[1]
        for name, unknown in (
            ("_min_sdf_m", np.float32(TRUNCATION_M)),
            ("_near_trail", False),
            ("_under_robot", False),
            ("_blocked", False),
        ):
            grown = np.full(shape, unknown)
            old = getattr(self, name)
            if old.size:
                grown[row:rows, col:cols] = old
            setattr(self, name, grown)
        self._origin_xy_m = grid.origin_m[:2].astype(float)

    def _ask_sdf(self, grid: VoxelGrid, state: Int8[np.ndarray, "rows cols"], sdf: SdfQuery, pose: Pose2) -> None:
        half = int(np.ceil(self.config.horizon_m / 2 / grid.resolution_m))
        col, row = np.floor((pose.xy_m - grid.origin_m[:2]) / grid.resolution_m).astype(int)
        rows = slice(max(row - half, 0), max(row + half, 0))
        cols = slice(max(col - half, 0), max(col + half, 0))
        window = state[rows, cols]
        near = ndimage.binary_dilation(window == OCCUPIED, iterations=2) & (window != UNKNOWN)
        cells = np.argwhere(near)
        remembered = self._min_sdf_m[rows, cols]
        remembered[...] = TRUNCATION_M
        if not len(cells):
            return
        heights = np.arange(
            self.footprint.z_min_m + 0.05, self.footprint.z_max_m + 1e-6, self.config.sdf_height_spacing_m
        )
        centres = (cells + np.array([rows.start, cols.start]))[:, ::-1] + 0.5
        xy = grid.origin_m[:2] + centres * grid.resolution_m
        points = np.concatenate([np.repeat(xy, len(heights), axis=0), np.tile(heights, len(xy))[:, None]], axis=1)
        values = sdf(points).reshape(len(cells), len(heights)).min(axis=1)
        remembered[cells[:, 0], cells[:, 1]] = values


def _signed_distance(free: Bool[np.ndarray, "rows cols"]) -> Float32[np.ndarray, "rows cols"]:
    """Distance of cell centres to the border of the free cells, positive inside [cells]."""
    # The pad makes the rim of the map a border, and a map without any free or any other cell well defined.
    padded = np.pad(free, 1)
    inside = np.asarray(ndimage.distance_transform_edt(padded))[1:-1, 1:-1]
    outside = np.asarray(ndimage.distance_transform_edt(~free)) if free.any() else np.full(free.shape, np.inf)
    return np.where(free, inside - 0.5, 0.5 - outside).astype(np.float32)


def _stamp_disc(
    layer: Bool[np.ndarray, "rows cols"], grid: VoxelGrid, xy_m: Float[np.ndarray, 2], radius_m: float
) -> None:
    resolution = grid.resolution_m
    reach = int(np.ceil(radius_m / resolution))
    col, row = np.floor((xy_m - grid.origin_m[:2]) / resolution).astype(int)
    rows = np.arange(max(row - reach, 0), min(row + reach + 1, layer.shape[0]))
    cols = np.arange(max(col - reach, 0), min(col + reach + 1, layer.shape[1]))
    if not (len(rows) and len(cols)):
        return
    y = grid.origin_m[1] + (rows + 0.5) * resolution - xy_m[1]
    x = grid.origin_m[0] + (cols + 0.5) * resolution - xy_m[0]
    disc = x[None, :] ** 2 + y[:, None] ** 2 <= radius_m**2
    layer[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1][disc] = True


def _enclosed_holes(unknown: Bool[np.ndarray, "rows cols"], max_cells: float) -> Bool[np.ndarray, "rows cols"]:
    labels = np.empty(unknown.shape, np.int32)
    count = int(ndimage.label(unknown, output=labels))  # pyright: ignore[reportArgumentType]
    if not count:
        return unknown
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    small = sizes <= max_cells
    small[0] = False
    return small[labels]


def _crossings(
    field: Float32[np.ndarray, "rows cols"] | None,
    free: Bool[np.ndarray, "rows cols"],
    beyond: Bool[np.ndarray, "rows cols"],
    origin_xy_m: Float[np.ndarray, 2],
    resolution_m: float,
) -> Float[np.ndarray, "n 2"]:
    """Points between a free cell and a neighbour ``beyond``, where ``field`` is zero (or half-way without a field)."""
    points = []
    for d_row, d_col in ((0, 1), (1, 0)):
        here = (slice(0, free.shape[0] - d_row), slice(0, free.shape[1] - d_col))
        there = (slice(d_row, None), slice(d_col, None))
        border = (free[here] & beyond[there]) | (beyond[here] & free[there])
        cells = np.argwhere(border)
        if field is None:
            share = np.full(len(cells), 0.5)
        else:
            a, b = field[here][border], field[there][border]
            share = np.where(a * b < 0, a / np.where(a == b, 1.0, a - b), 0.5)
        xy = cells[:, ::-1] + 0.5 + share[:, None] * [d_col, d_row]
        points.append(origin_xy_m + xy * resolution_m)
    return np.concatenate(points)
