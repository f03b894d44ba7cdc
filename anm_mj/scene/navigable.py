"""Where the robot can stand: on the floor, clear of obstacles, and connected to the rest of the floor."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int
from scipy import ndimage

from anm_mj.errors import SceneError
from anm_mj.scene.folder import Scene
from anm_mj.scene.raster import Grid, clip_to_slab, distance_cells, grid_over, label_components, level_mask, rasterise
from anm_mj.types import Footprint, Pose2

if TYPE_CHECKING:
    from anm_mj.geometry.clearance import Clearance

RESOLUTION_M = 0.025
"""Cell size of the grid of standing places [m]."""
MAX_CELLS = 8_000_000
"""Larger scenes, from 70 m square on, get cells of a multiple of that size."""
FLOOR_TOLERANCE_M = 0.06
"""Largest distance of the floor from z = 0 [m]."""
_START_MARGIN_M = 0.12
"""Extra clearance of start poses, where the scene has room for it [m]."""
_NUM_STARTS = 8
_MAX_PLACES = 1_000_000
_ATTEMPTS = 1000
"""The grid of standing places is accurate to one cell, so a few of its cells fail the exact test."""
_MIN_AREA_M2 = 0.5
"""A scene with less room was misread, or is too small for a robot [m2]."""
_WALLED_DIRECTIONS = 7
"""Of eight; a place with obstacles in at least this many lies indoors: beside a building, half of them are open."""
_MOSTLY_WALLED = 0.9
"""Where at least this share of the floor is indoors, doors and windows alone make the rest seem outdoors."""


@dataclass(frozen=True, eq=False)
class NavigableArea:
    """Places on the floor where a cylinder can stand, on a grid."""

    grid: Grid
    clearance_m: Float32[np.ndarray, "rows cols"]
    """Distance from a cell's centre to the nearest obstacle or missing floor, on the grid [m]; 0 in an obstacle."""
    component: Int[np.ndarray, "rows cols"]
    """0 where the cylinder may not stand; else the number of the connected component, 1 being the one with the most
    floor indoors, or the largest where there is none."""
    indoors: Bool[np.ndarray, "rows cols"]
    """Whether obstacles stand around a place, in seven of eight directions."""

    @property
    def area_m2(self) -> float:
        """Area of the first component, counted at the cylinder's axis [m2]."""
        return float(np.count_nonzero(self.component == 1)) * self.grid.resolution_m**2

    def nearest(self, xy_m: Float64[np.ndarray, "2"]) -> Float64[np.ndarray, "2"]:
        """Centre of the cell of the first component that is nearest to a place in the world [m]."""
        places = self.places(1)
        return places[np.argmin(((places - xy_m) ** 2).sum(axis=1))]

    def places(self, component: int) -> Float64[np.ndarray, "n 2"]:
        """Centres of all cells of a component, row by row [m]."""
        return self.grid.centres_m(*np.nonzero(self.component == component))


def navigable_area(
    triangles_m: Float[np.ndarray, "f 3 3"], footprint: Footprint, obstacles_m: Float[np.ndarray, "o 3 3"] | None = None
) -> NavigableArea:
    """Where an upright cylinder can stand on a floor at z = 0 among triangles in the world.

    The floor is whatever lies level at z = 0 among triangles and obstacles. Obstacles are the triangles themselves
    unless given. Distances between cell centres are exact to one cell; :func:`is_clear` is exact. Raises SceneError if
    there is hardly such a place.
    """
    if obstacles_m is None:
        obstacles_m = triangles_m
    else:
        triangles_m = np.concatenate([triangles_m, obstacles_m])
    size_m = np.ptp(triangles_m.reshape(-1, 3)[:, :2], axis=0)
    cell_m = RESOLUTION_M * max(1, math.ceil(math.sqrt(float(size_m.prod()) / RESOLUTION_M**2 / MAX_CELLS)))
    grid = grid_over(triangles_m, cell_m, 2 * cell_m)
    blocked = rasterise(clip_to_slab(obstacles_m, footprint.z_min_m, footprint.z_max_m), grid)
    # Joints between floor tiles and thresholds leave slits that no wheel falls into.
    floor = floor_cells(triangles_m, grid, closing_cells=2)
    clearance = (distance_cells(~blocked) * grid.resolution_m).astype(np.float32)
    labels, num = label_components((clearance >= footprint.radius_m) & floor)
    indoors = _indoors(blocked)
    sizes, walled = (np.bincount(own.ravel(), minlength=num + 1) for own in (labels, labels[indoors]))
    sizes[0] = walled[0] = 0
    largest_m2 = float(sizes.max()) * grid.resolution_m**2
    if largest_m2 < _MIN_AREA_M2:
        raise SceneError(
            f"A robot of radius {footprint.radius_m:g} m and height {footprint.z_max_m:g} m has only {largest_m2:.2g} "
            f"m2 to move on a floor within {FLOOR_TOLERANCE_M * 100:g} cm of z = 0, and needs {_MIN_AREA_M2:g} m2: "
            "check the up axis and the scale."
        )
    # The ground around a building with shut doors may be larger than its rooms.
    is_building = float(walled.max()) * grid.resolution_m**2 >= _MIN_AREA_M2
    order = np.lexsort((-sizes, -walled if is_building else -sizes))
    rank = np.zeros(num + 1, dtype=np.int64)
    rank[order[:num]] = np.arange(1, num + 1)
    # A robot can drive along the edge of the floor, but starts should keep away from it.
    to_edge = (distance_cells(floor) * grid.resolution_m).astype(np.float32)
    return NavigableArea(grid, np.minimum(clearance, to_edge), rank[labels], indoors)


def _indoors(blocked: Bool[np.ndarray, "rows cols"]) -> Bool[np.ndarray, "rows cols"]:
    """Cells from which rays along the two axes and the two diagonals meet an obstacle in nearly every direction."""
    met = np.zeros(blocked.shape, np.uint8)
    for turned in (0, 1, 2, 3):
        cells, count = np.rot90(blocked, turned), np.rot90(met, turned)
        count += np.logical_or.accumulate(cells, axis=0)
        row = np.zeros(cells.shape[1], bool)
        for k in range(len(cells)):
            row = cells[k] | np.concatenate([[False], row[:-1]])
            count[k] += row
    return np.asarray((met >= _WALLED_DIRECTIONS) & ~blocked)


def floor_cells(
    triangles_m: Float[np.ndarray, "f 3 3"], grid: Grid, closing_cells: int
) -> Bool[np.ndarray, "rows cols"]:
    """Cells with a floor at z = 0, after closing gaps of up to twice ``closing_cells``."""
    level = clip_to_slab(triangles_m[level_mask(triangles_m)], -FLOOR_TOLERANCE_M, FLOOR_TOLERANCE_M)
    return np.asarray(ndimage.binary_closing(rasterise(level, grid), iterations=closing_cells), dtype=bool)


def with_floor_of(
    triangles_m: Float[np.ndarray, "f 3 3"], obstacles_m: Float[np.ndarray, "o 3 3"]
) -> Float[np.ndarray, "n 3 3"]:
    """Triangles that are drawn, and those of obstacles at z = 0: the robot stands on a floor that nobody sees, too."""
    is_floor = np.abs(obstacles_m[:, :, 2]).max(axis=1) <= FLOOR_TOLERANCE_M
    return np.concatenate([triangles_m, obstacles_m[is_floor]])


def pooled(area: NavigableArea, cells: int) -> NavigableArea:
    """The same area at ``cells`` times the cell size; each cell is as good as the best of those it replaces."""
    from skimage.measure import block_reduce

    # Components are numbered from the largest, and 0 is none.
    none = np.iinfo(area.component.dtype).max
    best = block_reduce(np.where(area.component > 0, area.component, none), cells, np.min, cval=none)
    clearance, indoors = block_reduce(area.clearance_m, cells, np.max), block_reduce(area.indoors, cells, np.any)
    grid = Grid(area.grid.origin_xy_m, area.grid.resolution_m * cells, *best.shape)
    return NavigableArea(grid, clearance, np.where(best == none, 0, best), indoors)


def choose_starts(area: NavigableArea, footprint: Footprint, num: int = _NUM_STARTS) -> tuple[Pose2, ...]:
    """Start poses in the first component, by farthest-point sampling, facing the longest free line of sight.

    The first, the default, is nearest to the middle of the floor. Where the component reaches outdoors, the others lie
    indoors as well.
    """
    reachable = area.component == 1
    walled = reachable & area.indoors
    if _MIN_AREA_M2 / area.grid.resolution_m**2 <= walled.sum() < _MOSTLY_WALLED * reachable.sum():
        reachable = walled
    roomy = reachable & (area.clearance_m >= footprint.radius_m + _START_MARGIN_M)
    rows, cols = np.nonzero(roomy if np.count_nonzero(roomy) >= num else reachable)
    # One in a few of a million places serves as well.
    rows, cols = (own[:: max(1, len(rows) // _MAX_PLACES)] for own in (rows, cols))
    cells = np.stack([rows, cols], axis=1).astype(np.float64)
    chosen = [int(np.argmin(((cells - cells.mean(axis=0)) ** 2).sum(axis=1)))]
    distance = np.full(len(cells), np.inf)
    while len(chosen) < min(num, len(cells)):
        distance = np.minimum(distance, ((cells - cells[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(np.argmax(distance)))
    free = area.clearance_m > 0.0
    return tuple(_start_at(area, free, int(rows[i]), int(cols[i])) for i in chosen)


def _start_at(area: NavigableArea, free: Bool[np.ndarray, "rows cols"], row: int, col: int) -> Pose2:
    """The pose at a cell that faces the longest run of free cells, of 24 directions."""
    reach = np.arange(1, max(free.shape) + 1)

    def run(yaw_deg: int) -> int:
        rows = np.round(row + reach * math.sin(math.radians(yaw_deg))).astype(int)
        cols = np.round(col + reach * math.cos(math.radians(yaw_deg))).astype(int)
        inside = (rows >= 0) & (rows < free.shape[0]) & (cols >= 0) & (cols < free.shape[1])
        open_cells = np.zeros(len(reach), dtype=bool)
        open_cells[inside] = free[rows[inside], cols[inside]]
        return int(np.argmin(open_cells)) if not open_cells.all() else len(reach)

    x, y = area.grid.centres_m(row, col)
    yaw_deg = max(range(0, 360, 15), key=run)
    return Pose2(round(float(x), 3), round(float(y), 3), math.radians(yaw_deg - 360 if yaw_deg > 180 else yaw_deg))


@functools.lru_cache(maxsize=4)
def scene_area(scene: Scene, footprint: Footprint) -> NavigableArea:
    """Where a robot may stand in a scene; computed once for both. Raises SceneError if hardly anywhere."""
    vertices, faces = scene.triangles()
    solid_vertices, solid_faces = scene.obstacles()
    same = solid_faces is faces
    return navigable_area(vertices[faces], footprint, None if same else solid_vertices[solid_faces])


@functools.lru_cache(maxsize=4)
def scene_clearance(scene: Scene, footprint: Footprint) -> Clearance:
    """Exact clearance of a robot among a scene's obstacles; built once per scene and footprint."""
    # Loads coal, which takes a third of a second: too long for commands that only list or import scenes.
    from anm_mj.geometry.clearance import Clearance

    return Clearance(*scene.obstacles(), footprint)


def is_clear(scene: Scene, pose: Pose2, footprint: Footprint) -> bool:
    """True if the robot's cylinder touches no obstacle at a pose and has floor below; exact up to the floor's grid."""
    area = scene_area(scene, footprint)
    col, row = np.floor((pose.xy_m - area.grid.origin_xy_m) / area.grid.resolution_m).astype(int)
    if not (0 <= row < area.grid.rows and 0 <= col < area.grid.cols) or area.clearance_m[row, col] == 0.0:
        return False
    return not scene_clearance(scene, footprint).collides(pose)


def sample_start(scene: Scene, footprint: Footprint, random: np.random.Generator) -> Pose2:
    """A pose drawn uniformly from the largest connected area of a scene, with a uniform heading. Raises SceneError if
    there is hardly a place to stand.
    """
    places = scene_area(scene, footprint).places(1)
    for _ in range(_ATTEMPTS):
        x, y = places[random.integers(len(places))].tolist()
        pose = Pose2(x, y, math.pi - random.uniform(0.0, math.tau))
        if is_clear(scene, pose, footprint):
            return pose
    raise SceneError(f"Scene {scene.name} has no clear place for the robot; check it with `anm-mj scene check`.")


def require_clear(scene: Scene, pose: Pose2, footprint: Footprint) -> None:
    """Accept a start pose, or raise an error that names the nearest one. Raises SceneError if the robot does not fit at
    the pose, or there is no floor below it.
    """
    if is_clear(scene, pose, footprint):
        return
    near = scene_area(scene, footprint).nearest(pose.xy_m)
    raise SceneError(
        f"The robot cannot start at ({pose.x_m:.2f}, {pose.y_m:.2f}) in scene {scene.name}: something stands within "
        f"{footprint.radius_m:g} m of there, or there is no floor. The nearest clear place is "
        f"({near[0]:.2f}, {near[1]:.2f})."
    )
