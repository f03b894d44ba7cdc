"""The map that a robot moving in the plane needs: what its body would touch, what it would not, what nobody knows.

A column of the occupancy grid over the body's heights is occupied where anything was hit, free where enough of it was
seen through, unknown elsewhere. Where the view goes through to below the floor there is none, as beyond a door that
leads out of the model, and the column counts as occupied. Near surfaces the neural map sharpens it: the minimum of the
SDF over the heights (paper, footnote 1) says where within a cell the surface lies. A sign that the field only
extrapolates never opens a way: the SDF is asked next to observed surface alone.

The map is kept up to date, not rebuilt: an update reads the blocks of the occupancy grid that changed since the last
one, so its cost does not grow with the scene.
"""

import math

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int8, UInt16

from anm_mj import _native
from anm_mj.frames import world_to_cell
from anm_mj.planning.borders import BorderPoints
from anm_mj.planning.change_reader import ChangeReader
from anm_mj.planning.distance_transform import capped_distance_cells
from anm_mj.planning.field_of_view import FieldOfView
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.start_floor import blind_radius_m, radius_to_seen_floor_m
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, Footprint, OccupancyGrid, Pose2, SdfQuery, TopDownMap
from anm_mj.utils.arrays import Window, bounds, clamp, dilate, dilate_mask, embed, relative_to, union

COLLISION_CELLS, SMALL_COLLISION_CELLS = 2, 1
"""Radius of the obstacle that a collision leaves in the map, and its radius once it closed the only way on [cells]."""
MAX_CLEARANCE_M = 1.2
"""Larger clearances are given as this, or as the cell beyond what paths keep where that is more [m]: a body has no use
for more, and near ones can be kept up locally."""
MAX_DEPTH_M = 0.2
"""Clearance inside of obstacles and the unknown is given down to minus this [m]."""
LOW_SEEN_M = 3.0
"""In the lowest layer surface counts as an obstacle when it was seen from within this [m]: of what was seen from
farther, a camera that nods takes the floor for one."""
NO_FLOOR_M = 0.1
"""A column that is seen free from z = 0 down to this depth has no floor [m]."""
SAME_PLACE_M = 0.01
"""A robot that moved less than this only turned: it adds nothing to the trajectory [m]."""
_BESIDE_CELLS = 2
"""Columns so near to surface have its zero-crossing within them, or beside them."""
_HOLE_WIDTH_CELLS = 20
"""Small unknown patches are no wider than about this."""
_HOLE_REACH_CELLS = 20
"""Unknown patches are followed this far beyond what changed, to see whether they are small and enclosed."""


class TopDownMapper:
    """Keeps the top-down map up: columns from occupancy, minimum SDF beside surfaces inside the horizon."""

    def __init__(self, config: PlanningConfig, footprint: Footprint):
        """Start with an empty map for a body."""
        self.config = config
        self.footprint = footprint
        self.trajectory_xy_m: list[Float[np.ndarray, "2"]] = []
        """Where the robot has been [m]."""
        self._changes = ChangeReader()
        self._starts_xy_m: list[Float[np.ndarray, "2"]] = []
        """Where runs began, this one and those that it continues [m]."""
        self._num_prior = 0
        """The first places of the trajectory are of prior runs; their number."""
        self._new_trajectory_xy_m: list[Float[np.ndarray, "2"]] = []
        self._collisions_xy_m: list[Float[np.ndarray, "2"]] = []
        self._new_collisions_xy_m: list[Float[np.ndarray, "2"]] = []
        self._collision_cells = COLLISION_CELLS
        self._origin_xy_m = np.zeros(2)
        self._truncation_m = 0.0
        self._layers = _Layers()
        self._borders = BorderPoints()
        self._start_radius_m = config.start_radius_m

    def add_collision(self, xy_m: Float[np.ndarray, "2"]) -> None:
        """Remember a place where the robot met something that the map does not show [m]."""
        self._collisions_xy_m.append(xy_m)
        self._new_collisions_xy_m.append(xy_m)

    def shrink_collisions(self) -> bool:
        """Draw the obstacles that collisions left as small as they may be, from now on; whether this may open a path.

        What the robot met is often smaller than what keeps it from bumping into it again, which may close the only way
        on.
        """
        if not self._collisions_xy_m or self._collision_cells == SMALL_COLLISION_CELLS:
            return False
        self._collision_cells = SMALL_COLLISION_CELLS
        self._layers.collision.fill(False)
        self._new_collisions_xy_m = list(self._collisions_xy_m)
        return True

    @property
    def any_collision(self) -> bool:
        """Whether the robot has collided so far."""
        return bool(self._collisions_xy_m)

    def visit(self, xy_m: Float[np.ndarray, "2"]) -> None:
        """Add a place to the robot's trajectory: the floor there is free [m]."""
        is_start = len(self.trajectory_xy_m) == self._num_prior
        if not is_start and math.dist(xy_m, self.trajectory_xy_m[-1]) < SAME_PLACE_M:
            return
        if is_start:
            self._starts_xy_m.append(xy_m)
        self.trajectory_xy_m.append(xy_m)
        self._new_trajectory_xy_m.append(xy_m)

    def continue_from(self, places_xy_m: Float[np.ndarray, "n 2"]) -> None:
        """Begin with the trajectory of a prior run, in order [m]; call it before the first place is added."""
        for xy in places_xy_m:
            self.visit(xy)
        self._num_prior = len(self.trajectory_xy_m)

    def update(
        self, grid: OccupancyGrid, sdf: SdfQuery, truncation_m: float, pose: Pose2, camera: FieldOfView
    ) -> tuple[TopDownMap, Window | None]:
        """Bring the map up to date. Returns the map, and the part of the occupancy grid that was read for it; None for
        none.

        Args:
            grid: the occupancy; always the same one, as it grows.
            sdf: metric SDF of world points (N, 3).
            truncation_m: distance beyond which the SDF says no more than 'far' [m]; always the same.
            pose: where the robot stands: the centre of the horizon, and proof that the floor there is free.
            camera: what the robot sees with; its first one tells how much of the floor at the start it cannot see.
        """
        first = not self._layers.state.size
        self._truncation_m = truncation_m
        if first:
            self._start_radius_m = blind_radius_m(camera, self.footprint, self.config)
        self.visit(pose.xy_m)
        self._follow_growth(grid)
        window = self._changed_window(grid, pose, camera)
        changed = self._read_columns(grid, window)
        if first:
            known = np.where(self._layers.hit, 2, self._layers.num_free >= self._enough(grid))
            self._start_radius_m = radius_to_seen_floor_m(known, grid, self._starts_xy_m[-1], self._start_radius_m)
        changed += self._stamp(grid) + self._ask_sdf(grid, sdf, pose)
        if changed:
            self._decide(grid, union(changed))
        layers, resolution, origin = self._layers, grid.resolution_m, self._origin_xy_m
        surface, frontier = (
            origin + xy * resolution for xy in (self._borders.surface_cells, self._borders.frontier_cells)
        )
        arrays = layers.clearance_m.copy(), layers.state.copy()
        topdown = TopDownMap(*arrays, resolution, origin, surface, frontier, layers.no_floor.copy())
        return topdown, window

    def _changed_window(self, grid: OccupancyGrid, pose: Pose2, camera: FieldOfView) -> Window | None:
        """What changed within reach of where the robot has been since the last update; at first in the whole grid."""
        if len(self._new_trajectory_xy_m) == len(self.trajectory_xy_m):
            return self._changes.take(grid)
        places = np.array([*self._new_trajectory_xy_m, pose.xy_m])
        reach_m = self.config.update_reach_m * camera.corner_ratio  # To the edges of the views.
        return self._changes.take(grid, np.stack([places.min(axis=0) - reach_m, places.max(axis=0) + reach_m]))

    def _decide(self, grid: OccupancyGrid, changed: Window) -> None:
        """Derive state, field, clearance and borders again around a window in which what they derive from changed."""
        layers = self._layers
        # Whether an unknown patch is a hole may change as far away as the patch is wide.
        window = dilate(changed, _HOLE_WIDTH_CELLS, layers.state.shape)
        far_m = self._truncation_m
        state = self._column_state(grid, window)
        field = np.where(state == OCCUPIED, np.float32(-far_m / 2), np.float32(far_m))
        field = np.minimum(field, layers.min_sdf_m[window])
        # A body has stood here: whatever voxels and field say, the floor was passable.
        passable, collided = layers.under_robot[window], layers.collision[window]
        field[passable], state[passable] = far_m, FREE
        field[collided], state[collided] = -far_m / 2, OCCUPIED
        state[(field <= 0) & (state == FREE)] = OCCUPIED
        freed = bounds((state == FREE) != (layers.state[window] == FREE), window)
        moved = bounds((state != layers.state[window]) | (field != layers.field_m[window]), window)
        layers.state[window], layers.field_m[window] = state, field
        for part in freed:
            self._update_clearance(part, grid.resolution_m)
        self._borders.update(layers.state, layers.field_m, moved[0][0] if moved else slice(0, 0))

    def _read_columns(self, grid: OccupancyGrid, window: Window | None) -> list[Window]:
        """Count the free voxels of each column over the body's heights, note hits, and return where either changed."""
        if window is None:
            return []
        heights = grid.layers_between(self.footprint.z_min_m, self.footprint.z_max_m)
        body = grid.state[heights, window[0], window[1]]
        num_free = np.add.reduce((body == FREE).view(np.uint8), axis=0, dtype=np.uint16)
        hit = body.max(axis=0, initial=UNKNOWN) == OCCUPIED
        # What is as low as the body's underside may lie in a layer that is mostly below it.
        lowest = max(grid.layer_of(self.footprint.z_min_m), 0)
        for layer in range(lowest, min(heights.start, len(grid.state))):
            near = grid.seen_range_m[layer, window[0], window[1]] <= LOW_SEEN_M
            hit |= near & (grid.state[layer, window[0], window[1]] == OCCUPIED)
        deep, floor = grid.layer_of(-NO_FLOOR_M), grid.layer_of(0.0)
        if deep >= 0:
            below = grid.state[deep : floor + 1, window[0], window[1]]
            no_floor = (below == FREE).all(axis=0)
            self._layers.no_floor[window] = no_floor & ~hit
            hit |= no_floor
        layers = self._layers
        changed = bounds((num_free != layers.num_free[window]) | (hit != layers.hit[window]), window)
        layers.num_free[window], layers.hit[window] = num_free, hit
        return changed

    def _enough(self, grid: OccupancyGrid) -> float:
        """Free voxels that make a column known."""
        heights = grid.num_layers_between(self.footprint.z_min_m, self.footprint.z_max_m)
        return self.config.free_share * max(heights, 1)

    def _column_state(self, grid: OccupancyGrid, window: Window) -> Int8[np.ndarray, "rows cols"]:
        layers = self._layers
        around = dilate(window, _HOLE_REACH_CELLS, layers.state.shape)
        unknown = layers.num_free[around] < self._enough(grid)
        if self.footprint.is_wide:
            # For others a cell at the side of a passage does not matter.
            unknown &= ~layers.hit[around]
        holes = np.zeros_like(unknown)
        max_cells = self.config.hole_area_m2 / grid.resolution_m**2
        _native.small_components(unknown.view(np.uint8), max_cells, holes.view(np.uint8))
        inner = relative_to(window, around)
        state = np.where(unknown[inner] & ~holes[inner], np.int8(UNKNOWN), np.int8(FREE))
        state[layers.near_trajectory[window]] = FREE
        state[layers.hit[window]] = OCCUPIED
        return state

    def _follow_growth(self, grid: OccupancyGrid) -> None:
        """Keep what is remembered aligned with a grid that has grown."""
        shape = grid.state.shape[1:]
        old = self._layers
        if old.state.shape == shape and np.allclose(self._origin_xy_m, grid.origin_m[:2]):
            return
        start = np.rint((self._origin_xy_m - grid.origin_m[:2]) / grid.resolution_m).astype(int)[::-1]
        old.grow(shape, start, self._truncation_m)
        self._origin_xy_m = grid.origin_m[:2].astype(float)
        # Borders are counted from the corner, which has moved even if nothing within reach has changed.
        self._borders.update(old.state, old.field_m, slice(0, 0))

    def _stamp(self, grid: OccupancyGrid) -> list[Window]:
        """Draw new places of the trajectory and new obstacles into their layers, and return where those are.

        Places that the grid does not hold yet wait until it does.
        """
        layers, body, cell = self._layers, self.footprint.radius_m, grid.resolution_m
        is_first = len(self._new_trajectory_xy_m) == len(self.trajectory_xy_m)
        around = max(body, COLLISION_CELLS * cell)
        stamped, later = list(self._new_collisions_xy_m), []
        for number, xy in enumerate(self._new_trajectory_xy_m):
            # Where a prior run stood, something may stand now.
            is_own = not is_first or number >= self._num_prior
            row, col = world_to_cell(xy[None], grid.origin_m[:2], cell)[0]
            if is_own and not (0 <= row < layers.state.shape[0] and 0 <= col < layers.state.shape[1]):
                # A camera ahead of the base has seen nothing about the base yet.
                later.append(xy)
                continue
            is_start = any(xy is start for start in self._starts_xy_m)
            radius_m = max(body, self._start_radius_m) if is_start else body
            _stamp_disc(layers.near_trajectory, grid, xy, radius_m)
            if is_own:
                _stamp_disc(layers.under_robot, grid, xy, body - cell)
            stamped.append(xy)
            around = max(around, radius_m)
        for xy in self._new_collisions_xy_m:
            _stamp_disc(layers.collision, grid, xy, self._collision_cells * cell)
        self._new_trajectory_xy_m, self._new_collisions_xy_m = later, []
        if not stamped:
            return []
        low, high = np.min(stamped, axis=0) - around - cell, np.max(stamped, axis=0) + around + cell
        first = np.floor((low - grid.origin_m[:2]) / cell).astype(int)[::-1]
        last = np.ceil((high - grid.origin_m[:2]) / cell).astype(int)[::-1]
        return [clamp(first, last, layers.state.shape)]

    def _ask_sdf(self, grid: OccupancyGrid, sdf: SdfQuery, pose: Pose2) -> list[Window]:
        """Query the minimum SDF of the horizon's columns beside surface again, and return where it changed.

        The field learns on where no depth changes: asked only where that did, what it said at first would stay.
        Columns with a hit are not asked for: they are occupied, whatever the SDF says.
        """
        layers = self._layers
        centre = world_to_cell(pose.xy_m[None], grid.origin_m[:2], grid.resolution_m)[0]
        half = int(np.ceil(self.config.horizon_m / 2 / grid.resolution_m))
        window = clamp(centre - half, centre + half, layers.state.shape)
        around = dilate(window, _BESIDE_CELLS, layers.state.shape)
        beside = dilate_mask(dilate_mask(layers.hit[around]))[relative_to(window, around)]
        cells = np.argwhere(beside & ~layers.hit[window] & (layers.num_free[window] > 0))
        remembered = layers.min_sdf_m[window]
        before = remembered.copy()
        remembered[...] = self._truncation_m
        if len(cells):
            z_min_m, z_max_m = self.footprint.z_min_m, self.footprint.z_max_m
            heights = np.arange(z_min_m + 0.05, z_max_m + 1e-6, self.config.sdf_height_spacing_m)
            heights = heights if len(heights) else np.array([0.5 * (z_min_m + z_max_m)])
            centres = (cells + np.array([window[0].start, window[1].start]))[:, ::-1] + 0.5
            points = np.empty((len(cells), len(heights), 3))
            points[..., :2] = (grid.origin_m[:2] + centres * grid.resolution_m)[:, None]
            points[..., 2] = heights
            remembered[cells[:, 0], cells[:, 1]] = sdf(points.reshape(-1, 3)).reshape(points.shape[:2]).min(axis=1)
        return bounds(before != remembered, window)

    def _update_clearance(self, window: Window, resolution_m: float) -> None:
        # No place would be clear enough for paths that keep as much as the cap, from the middle of a cell.
        kept = math.ceil((self.footprint.radius_m + self.config.margin_m) / resolution_m) + 1
        cap, depth = max(math.ceil(MAX_CLEARANCE_M / resolution_m), kept), math.ceil(MAX_DEPTH_M / resolution_m + 0.5)
        layers = self._layers
        reached = dilate(window, cap, layers.state.shape)
        needed = dilate(reached, cap, layers.state.shape)
        free = layers.state[needed] == FREE
        inner = relative_to(reached, needed)
        # A pad makes the rim of the map a border; at the rim of a part of it, it is farther away than the cap.
        inside = capped_distance_cells(np.pad(free, 1), cap)[1:-1, 1:-1][inner]
        outside = capped_distance_cells(~free, depth)[inner]
        clearance = np.where(free[inner], inside - np.float32(0.5), np.float32(0.5) - outside)
        layers.clearance_m[reached] = np.maximum(clearance * np.float32(resolution_m), np.float32(-MAX_DEPTH_M))


class _Layers:
    """What is remembered of every cell."""

    def __init__(self) -> None:
        shape = 0, 0
        self.num_free: UInt16[np.ndarray, "rows cols"] = np.zeros(shape, np.uint16)
        self.hit: Bool[np.ndarray, "rows cols"] = np.zeros(shape, bool)
        self.no_floor: Bool[np.ndarray, "rows cols"] = np.zeros(shape, bool)
        self.min_sdf_m: Float32[np.ndarray, "rows cols"] = np.zeros(shape, np.float32)
        self.near_trajectory: Bool[np.ndarray, "rows cols"] = np.zeros(shape, bool)
        self.under_robot: Bool[np.ndarray, "rows cols"] = np.zeros(shape, bool)
        self.collision: Bool[np.ndarray, "rows cols"] = np.zeros(shape, bool)
        self.state: Int8[np.ndarray, "rows cols"] = np.zeros(shape, np.int8)
        self.field_m: Float32[np.ndarray, "rows cols"] = np.zeros(shape, np.float32)
        self.clearance_m: Float32[np.ndarray, "rows cols"] = np.zeros(shape, np.float32)

    def grow(self, shape: tuple[int, ...], start: Int[np.ndarray, "2"], far_m: float) -> None:
        """Make all layers larger; ``start`` is where the present cell [0, 0] moves to, ``far_m`` the SDF far away."""
        blank = {"min_sdf_m": far_m, "field_m": far_m, "state": UNKNOWN, "clearance_m": -MAX_DEPTH_M}
        for name, layer in vars(self).items():
            setattr(self, name, embed(layer, shape, start, blank.get(name, 0)))


def _stamp_disc(
    layer: Bool[np.ndarray, "rows cols"], grid: OccupancyGrid, xy_m: Float[np.ndarray, "2"], radius_m: float
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
