"""A two-dimensional occupancy grid from the depth camera used as a planar scanner, for policies with their own map.

Every image column is one beam of a scan. It ends at the nearest surface within the heights of the robot's body, or
where it goes through a hole in the floor, and the cells before that are free (Moravec and Elfes, ICRA 1985; Yamauchi,
CIRA 1997). Its range can be limited, as in the published configurations of the baselines; that of the neural map's
occupancy grid cannot.

An occupied cell remembers where in it the beams ended, so clearance is measured to surfaces and not to cells. The graph
of the other policies measures it to zero-crossings of the field; without this rule a policy with a grid would not fit
through passages that they pass.
"""

import math
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage
from skimage.draw import polygon

from anm_mj.errors import PlanError
from anm_mj.frames import cell_to_world, pixel_directions, world_to_cell
from anm_mj.planning.change_reader import NOTHING_OBSERVED
from anm_mj.planning.topdown_mapper import COLLISION_CELLS, SMALL_COLLISION_CELLS
from anm_mj.sensing.missing_floor import MissingFloor
from anm_mj.sensing.pixel_state import measured_pixels
from anm_mj.types import (
    FORWARD_STEP_M,
    FREE,
    OCCUPIED,
    UNKNOWN,
    Footprint,
    Intrinsics,
    Observation,
    OccupancyGrid,
    Pose2,
    TopDownMap,
)
from anm_mj.utils.arrays import embed

RESOLUTION_M = 0.05
GROWTH_CELLS = 128
"""The grid grows in blocks of this many cells."""
HIT, PASS = 0.85, -0.4
"""Log-odds that one scan adds to a cell that a beam ends in, and to one that a beam passes through."""
DROP_M = 0.1
"""A point lower than this below the floor shows that there is none where its ray goes through [m]."""
LEVEL_SINE = 0.01
"""A camera counts as level when the elevation of its axis has a smaller sine."""
JOINED_M = 0.25
"""Ends of neighbouring beams that are nearer to each other than this lie on one surface [m]."""
NEAR_CELLS = 12
"""Clearance is measured to surfaces in cells that are no farther than this from an occupied one; farther ones keep the
distance between cells."""
RENEWAL = 0.5
"""Weight of the newest scan in where the surface of a cell lies."""
MOST, LEAST = 3.5, -2.0
"""Bounds of a cell's log-odds, so that later scans can still change its state."""
MOST_PRIOR, LEAST_PRIOR = 1.1, -0.8
"""The same for what a prior run left: one scan or three change it."""


class ScanGrid:
    """Log-odds of occupancy in the plane; the grid grows with the reach of the scans."""

    def __init__(self, footprint: Footprint, range_m: float):
        """Start with nothing known; obstacles matter within the body's heights, and beams end at ``range_m``."""
        self.footprint = footprint
        self.range_m = range_m
        self.origin_xy_m = np.zeros(2)
        """World x, y of the outer corner of cell [0, 0]."""
        self._missing_floor = MissingFloor()
        self.log_odds = np.zeros((0, 0), np.float32)
        """NaN in cells that no beam has touched."""
        self.surface_m = np.zeros((2, 0, 0), np.float32)
        """Where in each cell the beams ended: x and y from its centre [m]; NaN where none did."""
        self._collisions_xy_m: list[Float[np.ndarray, "2"]] = []
        """Centres of the obstacles that collisions left as large as any [m]."""

    def continue_from(self, log_odds: Float[np.ndarray, "rows cols"], origin_xy_m: Float[np.ndarray, "2"]) -> None:
        """Begin with the grid of a prior run, of which a few scans change what has changed since."""
        # The grid grows in whole blocks from a corner of theirs.
        self.origin_xy_m = np.rint(origin_xy_m / RESOLUTION_M) * RESOLUTION_M
        self.log_odds = np.clip(log_odds.astype(np.float32), LEAST_PRIOR, MOST_PRIOR)
        self.surface_m = np.full((2, *self.log_odds.shape), np.nan, np.float32)

    def read_occupancy(self, grid: OccupancyGrid, poses: Float[np.ndarray, "n 3"]) -> None:
        """Begin with what a voxel grid says of the heights of the body, and with where the robot was (x, y, yaw)."""
        size_m = np.array(grid.state.shape[:0:-1]) * grid.resolution_m
        corners = np.stack([grid.origin_m[:2], grid.origin_m[:2] + size_m])
        if not size_m.all():
            return
        self._grow(corners)
        body = grid.state[grid.layers_between(self.footprint.z_min_m, self.footprint.z_max_m)]
        free = (body == FREE).mean(axis=0) > 0.5
        occupied = (body == OCCUPIED).any(axis=0)
        rows, cols = np.indices(self.log_odds.shape)
        xy_m = self.origin_xy_m + (np.stack([cols, rows], axis=-1).reshape(-1, 2) + 0.5) * RESOLUTION_M
        cells = world_to_cell(xy_m, grid.origin_m[:2], grid.resolution_m)
        inside = np.flatnonzero(((cells >= 0) & (cells < free.shape)).all(axis=1))
        where = tuple(cells[inside].T)
        flat = self.log_odds.reshape(-1)
        flat[inside[free[where]]] = LEAST_PRIOR
        for xy_m in poses[:, :2]:
            self.log_odds[self._disc(xy_m, self.footprint.radius_m)] = LEAST_PRIOR
        flat[inside[occupied[where]]] = MOST_PRIOR

    def integrate(self, observation: Observation) -> None:
        """Add a scan; the ground under the robot is free, because it stands there."""
        camera_xy_m = observation.T_world_camera[:2, 3]
        self._grow(np.stack([camera_xy_m - self.range_m, camera_xy_m + self.range_m]))
        depth_m, moved_m = observation.depth_m, observation.moved_m
        shown_m = depth_m if moved_m is None else np.fmin(depth_m, moved_m)  # Of the two, one is NaN.
        self._missing_floor.look(shown_m, observation.intrinsics, observation.T_world_camera, observation.range_m)
        end_m, hit = self._beams(observation)
        # Beams are planes of constant azimuth, as image columns are where the camera is level.
        level = _level(observation.T_world_camera[:3, :3])
        camera = observation.intrinsics
        horizon = Intrinsics(camera.width, 1, camera.fx, camera.fy, camera.cx, 0.5)
        columns = pixel_directions(horizon)[0] @ level.T
        directions = columns[:, :2] / np.linalg.norm(columns[:, :2], axis=1, keepdims=True)
        ends_xy_m = camera_xy_m + directions * end_m[:, None]
        hits_xy_m = _between_hits(ends_xy_m, hit)
        struck = self._mask(hits_xy_m)
        self._remember_surface(hits_xy_m)
        outline_xy_m = np.concatenate([camera_xy_m[None], ends_xy_m])
        col, row = ((outline_xy_m - self.origin_xy_m) / RESOLUTION_M - 0.5).T
        free = np.zeros(self.log_odds.shape, bool)
        free[polygon(row, col, free.shape)] = True
        free = (free & ~struck) | self._disc(observation.pose.xy_m, self.footprint.radius_m)
        self.log_odds[free] = np.maximum(np.nan_to_num(self.log_odds[free]) + PASS, LEAST)
        self.log_odds[struck] = np.minimum(np.nan_to_num(self.log_odds[struck]) + HIT, MOST)

    def block_ahead(self, pose: Pose2) -> None:
        """Mark a disc about the end of a forward step as occupied, because the robot collided on it: as large as in the
        map of the other policies, since what it touched need not lie straight ahead.
        """
        ahead = np.array([math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)])
        place = pose.xy_m + (self.footprint.radius_m + FORWARD_STEP_M) * ahead
        cell = world_to_cell(place[None], self.origin_xy_m, RESOLUTION_M)
        (centre,) = cell_to_world(cell, self.origin_xy_m, RESOLUTION_M)
        self.log_odds[self._collision(centre, COLLISION_CELLS)] = MOST
        self._collisions_xy_m.append(centre)

    def shrink_collisions(self, driven_xy_m: Float[np.ndarray, "n 2"]) -> bool:
        """Draw the obstacles that collisions left as small as they may be; whether this may open a path.

        As the map of the other policies does: a mark may close the only way. Where the base was, ``driven_xy_m`` [m],
        none is left: the robot may have hit something on its way back by no more than it had missed it before.
        """
        centres, self._collisions_xy_m = self._collisions_xy_m, []
        opened = np.zeros(self.log_odds.shape, bool)
        for centre in centres:
            opened |= self._collision(centre, COLLISION_CELLS)
        driven = self._mask(driven_xy_m) & opened
        for centre in centres:
            opened &= ~self._collision(centre, SMALL_COLLISION_CELLS)
        # Where beams ended there is an obstacle without any collision.
        opened = (driven | (opened & np.isnan(self.surface_m[0]))) & (self.log_odds > 0)
        self.log_odds[opened] = LEAST
        return bool(opened.any())

    def topdown(self) -> TopDownMap:
        """The grid as a map; clearance is the distance to the nearest obstacle [m], not to unknown ground. Without any
        obstacle it is the diagonal of the grid. Raises PlanError before the first scan.
        """
        if not self.log_odds.size:
            raise PlanError(NOTHING_OBSERVED)
        state = np.where(self.log_odds > 0, np.int8(OCCUPIED), np.int8(FREE))
        state[self._mask(self._missing_floor.places_xy_m())] = OCCUPIED
        state[np.isnan(self.log_odds)] = UNKNOWN
        occupied = state == OCCUPIED
        if not occupied.any():
            far_m = np.full(state.shape, math.hypot(*state.shape) * RESOLUTION_M, np.float32)
            return TopDownMap(far_m, state, RESOLUTION_M, self.origin_xy_m.copy())
        found: Any = ndimage.distance_transform_edt(~occupied, return_indices=True)
        cells, nearest = found
        clear_m = (cells - 0.5) * RESOLUTION_M
        near = (cells > 0) & (cells <= NEAR_CELLS)
        clear_m[near] = self._to_surfaces_m(occupied, np.argwhere(near), nearest[:, near].T)
        return TopDownMap(clear_m.astype(np.float32), state, RESOLUTION_M, self.origin_xy_m.copy())

    def _to_surfaces_m(
        self, occupied: Bool[np.ndarray, "rows cols"], cells: Int[np.ndarray, "n 2"], nearest: Int[np.ndarray, "n 2"]
    ) -> Float[np.ndarray, " n"]:
        """Distance of cells' centres to the nearest surface, in the nearest occupied cell or one around it [m].

        In an occupied cell that no beam ended in, the surface may be anywhere. Cells are rows and columns.
        """
        surface_m = np.where(occupied, np.nan_to_num(self.surface_m), np.inf)
        surface_m = np.pad(surface_m, ((0, 0), (1, 1), (1, 1)), constant_values=np.inf)
        unsure_m = np.pad(np.where(np.isnan(self.surface_m[0]), RESOLUTION_M / 2, 0.0), 1)
        least = np.full(len(cells), np.inf)
        for row, col in np.ndindex(3, 3):
            at = nearest + np.array([row, col])  # In the padded grid.
            dx, dy = surface_m[:, at[:, 0], at[:, 1]]
            between = (at - 1 - cells) * RESOLUTION_M
            away_m = np.hypot(between[:, 1] + dx, between[:, 0] + dy) - unsure_m[at[:, 0], at[:, 1]]
            least = np.minimum(least, away_m)
        return least

    def _remember_surface(self, hits_xy_m: Float[np.ndarray, "n 2"]) -> None:
        """Take in where the beams of a scan ended: the mean of each cell."""
        cells = world_to_cell(hits_xy_m, self.origin_xy_m, RESOLUTION_M)
        inside = ((cells >= 0) & (cells < self.log_odds.shape)).all(axis=1)
        cells, hits_xy_m = cells[inside], hits_xy_m[inside]
        from_centre_m = hits_xy_m - self.origin_xy_m - (cells[:, ::-1] + 0.5) * RESOLUTION_M
        struck, which, count = np.unique(
            np.ravel_multi_index(tuple(cells.T), self.log_odds.shape), return_inverse=True, return_counts=True
        )
        for axis in range(2):
            mean_m = np.bincount(which, from_centre_m[:, axis], minlength=len(struck)) / count
            flat = self.surface_m[axis].reshape(-1)
            before = np.where(np.isnan(flat[struck]), mean_m, flat[struck])
            flat[struck] = before + RENEWAL * (mean_m - before)

    def _beams(self, observation: Observation) -> tuple[Float[np.ndarray, " w"], Bool[np.ndarray, " w"]]:
        """Where the beam of each column ends [m], and whether it hits a surface there.

        The columns are those of a level camera: a tilted one's pixels are sorted by their azimuths.
        """
        depth_m = np.where(measured_pixels(observation), observation.depth_m, np.float32(np.nan))
        rays = pixel_directions(observation.intrinsics)
        height_m = observation.T_world_camera[2, 3] + depth_m * (rays @ observation.T_world_camera[2, :3])
        rotation = observation.T_world_camera[:3, :3]
        level = _level(rotation)
        is_level = bool(abs(rotation[2, 2]) < LEVEL_SINE)
        ahead = rays if is_level else rays @ (level.T @ rotation).T
        distance_m = depth_m * np.hypot(ahead[..., 0], 1.0 if is_level else ahead[..., 2])
        # Comparisons with NaN are false: a pixel without depth neither ends a beam nor lengthens it.
        obstacle = (height_m > self.footprint.z_min_m) & (height_m < self.footprint.z_max_m)
        nearest_m = np.where(obstacle, distance_m, np.inf)
        below = height_m < -DROP_M
        if below.any():
            # What lies below the floor is seen through a hole in it: there the ground ends. A noisy camera sees single
            # pixels of a far floor below it.
            below = np.asarray(ndimage.binary_opening(below, np.ones((3, 3))), bool)
            camera_m = observation.T_world_camera[2, 3]
            nearest_m[below] = distance_m[below] * camera_m / (camera_m - height_m[below])
        seen_m = np.where(height_m < self.footprint.z_max_m, distance_m, 0.0)
        if is_level:
            nearest_m, seen_m = nearest_m.min(axis=0), seen_m.max(axis=0)
        else:
            nearest_m, seen_m = _by_column(nearest_m, seen_m, ahead, observation.intrinsics)
        end_m = np.minimum(np.minimum(nearest_m, seen_m), self.range_m)
        return end_m, nearest_m <= end_m

    def _mask(self, xy_m: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "rows cols"]:
        mask = np.zeros(self.log_odds.shape, bool)
        cells = world_to_cell(xy_m, self.origin_xy_m, RESOLUTION_M)
        cells = cells[((cells >= 0) & (cells < mask.shape)).all(axis=1)]
        mask[cells[:, 0], cells[:, 1]] = True
        return mask

    def _collision(self, xy_m: Float[np.ndarray, "2"], cells: int) -> Bool[np.ndarray, "rows cols"]:
        # A little more, as rounding must not decide.
        return self._disc(xy_m, (cells + 0.2) * RESOLUTION_M)

    def _disc(self, xy_m: Float[np.ndarray, "2"], radius_m: float) -> Bool[np.ndarray, "rows cols"]:
        """Cells whose centres are so near to a place."""
        rows, cols = np.ogrid[: self.log_odds.shape[0], : self.log_odds.shape[1]]
        x = self.origin_xy_m[0] + (cols + 0.5) * RESOLUTION_M - xy_m[0]
        y = self.origin_xy_m[1] + (rows + 0.5) * RESOLUTION_M - xy_m[1]
        return x**2 + y**2 <= radius_m**2

    def _grow(self, corners_xy_m: Float[np.ndarray, "2 2"]) -> None:
        """Enlarge the grid until it holds a box; cells keep their values."""
        block_m = GROWTH_CELLS * RESOLUTION_M
        low, high = np.floor(corners_xy_m[0] / block_m) * block_m, np.ceil(corners_xy_m[1] / block_m) * block_m
        old = self.log_odds
        if old.size:
            low = np.minimum(low, self.origin_xy_m)
            high = np.maximum(high, self.origin_xy_m + np.array(old.shape[::-1]) * RESOLUTION_M)
        rows, cols = (round(length / RESOLUTION_M) for length in (high - low)[::-1])
        if (rows, cols) == old.shape:
            return
        start = np.rint((self.origin_xy_m - low) / RESOLUTION_M).astype(int)[::-1]
        self.log_odds = embed(old, (rows, cols), start, np.nan)
        self.surface_m = embed(self.surface_m, (2, rows, cols), np.array([0, *start]), np.nan)
        self.origin_xy_m = low


def _between_hits(ends_xy_m: Float[np.ndarray, "w 2"], hit: Bool[np.ndarray, " w"]) -> Float[np.ndarray, "n 2"]:
    """Where beams hit and, where two neighbours hit one surface, the points between them [m]."""
    step = np.diff(ends_xy_m, axis=0)
    joined = hit[:-1] & hit[1:] & (np.linalg.norm(step, axis=1) < JOINED_M)
    shares = np.arange(0.0, 1.0, RESOLUTION_M / JOINED_M / 2)
    between = ends_xy_m[:-1][joined, None] + step[joined, None] * shares[:, None]
    return np.concatenate([ends_xy_m[hit], between.reshape(-1, 2)])


def _level(rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """The rotation of a camera with the same heading that looks along the horizon."""
    if abs(rotation[2, 2]) < LEVEL_SINE:
        return rotation
    forward = np.array([rotation[0, 2], rotation[1, 2], 0.0])
    forward /= np.linalg.norm(forward)
    down = np.array([0.0, 0.0, -1.0])
    return np.stack([np.cross(down, forward), down, forward], axis=1)


def _by_column(
    nearest_m: Float[np.ndarray, "h w"],
    seen_m: Float[np.ndarray, "h w"],
    ahead: Float[np.ndarray, "h w 3"],
    intrinsics: Intrinsics,
) -> tuple[Float[np.ndarray, " w"], Float[np.ndarray, " w"]]:
    """Least and largest values of the pixels that a level camera would have in each of its columns.

    ``nearest_m`` is +inf for none, ``seen_m`` 0; ``ahead`` are the rays in the axes of the level camera.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        u = ahead[..., 0] / ahead[..., 2] * intrinsics.fx + intrinsics.cx
    inside = (ahead[..., 2] > 0.0) & (u >= 0.0) & (u < intrinsics.width)
    column = u[inside].astype(np.int64)
    nearest, seen = np.full(intrinsics.width, np.inf), np.zeros(intrinsics.width)
    np.minimum.at(nearest, column, nearest_m[inside])
    np.maximum.at(seen, column, np.nan_to_num(seen_m[inside]))
    return nearest, seen
