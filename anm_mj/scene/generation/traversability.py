"""Tests on a grid of one room whether the robot can still drive from every door to every other."""

import math

import numpy as np
import shapely
from jaxtyping import Bool, Float64

from anm_mj.scene.generation.building import RoomWall
from anm_mj.scene.generation.piece import Placed
from anm_mj.scene.raster import distance_in_walls, label_components

CELL_M = 0.05
_RADIUS_M = 0.25
"""The robot's radius and a margin [m]."""
_MIN_OPEN_SHARE = 0.45
"""Share of an empty room's free floor that stays within reach when it is furnished."""


class RoomGrid:
    """Cells of one room, aligned with those of all others."""

    def __init__(self, floor: shapely.Polygon, walls: tuple[RoomWall, ...]) -> None:
        x0, y0, x1, y1 = floor.bounds
        self.low_cell = (math.floor(x0 / CELL_M), math.floor(y0 / CELL_M))
        cols, rows = math.ceil(x1 / CELL_M) - self.low_cell[0], math.ceil(y1 / CELL_M) - self.low_cell[1]
        self.x_m = (self.low_cell[0] + np.arange(cols) + 0.5) * CELL_M
        self.y_m = (self.low_cell[1] + np.arange(rows) + 0.5) * CELL_M
        if floor.equals(shapely.box(*floor.bounds)):
            # Almost all generated rooms are rectangles, for which no test per cell is needed.
            across, up = (self.x_m > x0) & (self.x_m < x1), (self.y_m > y0) & (self.y_m < y1)
            self.floor: Bool[np.ndarray, "rows cols"] = up[:, None] & across[None, :]
        else:
            shapely.prepare(floor)
            self.floor = np.asarray(shapely.contains_xy(floor, *np.meshgrid(self.x_m, self.y_m)))
        points = [wall.wall.point((a + b) / 2, 0.45, 0.0)[:2] for wall in walls for a, b, _ in wall.gaps]
        self._before_doors = np.array(points).reshape(-1, 2)
        self._empty_joined, self._empty_share = self._reach(self.floor)

    def solid(self, placed: list[Placed]) -> Bool[np.ndarray, "rows cols"]:
        """Cells that pieces cover."""
        cells = np.zeros_like(self.floor)
        for piece in placed:
            flat = piece.piece.placement == "hang" and piece.piece.outline_m[1] > -0.15
            for corners in () if flat or piece.piece.placement == "rug" else piece.corners_m():
                self._fill(cells, corners)
        return cells

    def is_traversable(self, placed: list[Placed]) -> bool:
        """True if furniture disconnects no two doors, and leaves enough floor reachable."""
        joined, share = self._reach(self.floor & ~self.solid(placed))
        return bool((joined | ~self._empty_joined).all()) and share >= _MIN_OPEN_SHARE * self._empty_share

    def _reach(self, free: Bool[np.ndarray, "rows cols"]) -> tuple[Bool[np.ndarray, "doors doors"], float]:
        """Whether a way joins each door to each other, and the number of cells of the largest component at a door."""
        distance = distance_in_walls(free) * CELL_M
        labels, num = label_components(distance >= _RADIUS_M)
        sizes = np.bincount(labels.ravel(), minlength=num + 1)
        sizes[0] = 0
        rows, cols = np.nonzero(labels)
        doors = np.zeros(len(self._before_doors), dtype=np.int64)
        for k, place in enumerate(self._before_doors):
            away = np.hypot(self.x_m[cols] - place[0], self.y_m[rows] - place[1])
            if len(away) and away.min() < 0.35:
                nearest = int(np.argmin(away))
                doors[k] = labels[rows[nearest], cols[nearest]]
        joined = (doors[:, None] == doors[None, :]) & (doors[:, None] > 0)
        return joined, float(sizes[doors].max() if len(doors) else sizes.max())

    def _fill(self, cells: Bool[np.ndarray, "rows cols"], corners_m: Float64[np.ndarray, "4 2"]) -> None:
        low, high = corners_m.min(axis=0), corners_m.max(axis=0)
        half = CELL_M / 2
        cols = np.flatnonzero((self.x_m > low[0] - half) & (self.x_m < high[0] + half))
        rows = np.flatnonzero((self.y_m > low[1] - half) & (self.y_m < high[1] + half))
        if not len(cols) or not len(rows):
            return
        part = (slice(rows[0], rows[-1] + 1), slice(cols[0], cols[-1] + 1))
        along = np.roll(corners_m, -1, axis=0) - corners_m
        if np.abs(along).min(axis=1).max() < 1e-9:
            cells[part] = True
            return
        x, y = np.meshgrid(self.x_m[cols], self.y_m[rows])
        inside = np.ones(x.shape, dtype=bool)
        for (px, py), (dx, dy) in zip(corners_m, along / np.linalg.norm(along, axis=1, keepdims=True), strict=True):
            inside &= dx * (y - py) - dy * (x - px) > -half
        cells[part] |= inside
