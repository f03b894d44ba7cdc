"""Free, occupied and unknown space, fused from depth; it stands beside the neural field, which knows no "unknown".

Carving is conservative: a voxel becomes free only if the smallest depth in its whole pixel footprint lies behind it, so
a table leg of a few pixels keeps its voxels, and so do the voxels it might hide. A hit weighs as much as several
misses. Voxel centres lie at multiples of the voxel edge, so that a floor at z = 0 fills one layer and not, at random,
two.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int64, UInt16

from anm_mj.frames import pixel_directions
from anm_mj.mapping.config import OccupancyConfig
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, Intrinsics, VoxelGrid
from anm_mj.utils.arrays import embed

BLOCK = 16
"""Voxels along the edge of a block, the unit of growth and of change."""
SEEN_RANGE_STEP_M = 1.0
"""How much nearer a voxel must have been seen to count as changed: readers compare with whole metres [m]."""
_LAYER_BLOCKS, _PLANE_BLOCKS = 1, 4
"""Blocks that the grid grows by at least, in height and in the plane."""
_FOOTPRINT = 0.7
"""Half width in voxel edges of what counts as a voxel's footprint: half the diagonal of a face."""
_HALF_DIAGONAL = 0.5 * math.sqrt(3.0)
"""Half the diagonal of a voxel, in voxel edges."""
_HIT_FOCAL_PX = 64.0
"""Focal length at which every pixel marks a hit [px]; sharper images are thinned to about as many, other pixels being
taken from frame to frame."""
_MAX_REACH = 4
"""Levels of the footprint pyramid beyond the first; the last spans 33 pixels."""


class OccupancyGrid:
    """Voxels ``[layer, row, col]`` = ``[z, y, x]`` with 8-bit log-odds; grows by blocks and keeps what it holds."""

    def __init__(self, config: OccupancyConfig) -> None:
        self.config = config
        self._corner = np.zeros(3, np.int64)
        shape = (0, 0, 0)
        self._log_odds = np.zeros(shape, np.int8)
        self._state = np.zeros(shape, np.int8)
        self._seen_range_m = np.zeros(shape, np.float32)
        self._num_hits = np.zeros(shape, np.uint16)
        self._block_stamp = np.zeros(shape, np.int32)
        self._column_version = np.zeros((0, 0), np.int32)
        self._num_frames = 0
        self._rays: tuple[Intrinsics, Float32[np.ndarray, "h w 3"]] | None = None

    @property
    def grid(self) -> VoxelGrid:
        """The grid as it stands; its arrays are views, its version is the number of frames.

        A voxel counts as changed when its state did, or when ``seen_range_m`` fell to another whole number of
        ``SEEN_RANGE_STEP_M``.
        """
        origin = (self._corner - 0.5) * self.config.voxel_m
        return VoxelGrid(
            self._state, self._seen_range_m, origin, self.config.voxel_m, self._num_frames, self._column_version
        )

    @property
    def corner(self) -> Int64[np.ndarray, "3"]:
        """x, y, z index of cell [0, 0, 0]: its centre in the world in voxel edges; a multiple of ``BLOCK``."""
        return self._corner

    @property
    def num_hits(self) -> UInt16[np.ndarray, "layers rows cols"]:
        """Pixels of all frames that fell into each voxel, up to 65535; images are thinned to 64 px of focal length.

        Near, frontal and repeated views all add to it: it is the sampling density of the surface.
        """
        return self._num_hits

    @property
    def block_stamp(self) -> Int[np.ndarray, "layers rows cols"]:
        """For each block, the number of the last frame (from 1) that had a hit in it; 0 where none had."""
        return self._block_stamp

    @property
    def surface_volume_m3(self) -> float:
        """Volume of the blocks that ever had a hit in them [m3]: a measure of the scene that costs nothing to take."""
        return float(np.count_nonzero(self._block_stamp) * (BLOCK * self.config.voxel_m) ** 3)

    def integrate(
        self,
        depth_m: Float32[np.ndarray, "h w"],
        intrinsics: Intrinsics,
        T_world_camera: Float[np.ndarray, "4 4"],
    ) -> None:
        """Fuse one depth image: carve what was looked through, then mark what was hit.

        Args:
            depth_m: Planar depth [m]; +inf where the sensor looked farther than its range, NaN where it measured
                nothing.
            intrinsics: The camera.
            T_world_camera: Camera to world.
        """
        self._num_frames += 1
        rays = self._ray_directions(intrinsics)
        rotation = T_world_camera[:3, :3].astype(np.float32)
        position = T_world_camera[:3, 3].astype(np.float32)
        stride = max(1, round(intrinsics.fx / _HIT_FOCAL_PX))
        phase = self._num_frames % stride, self._num_frames // stride % stride
        pick = slice(phase[0], None, stride), slice(phase[1], None, stride)
        hit_depth = depth_m[pick]
        hit = (hit_depth > 0.0) & (hit_depth <= self.config.hit_range_m)
        hit_depth = hit_depth[hit]
        inverse = np.float32(1.0 / self.config.voxel_m)
        scaled = (rays[pick][hit] * hit_depth[:, None]) @ (rotation.T * inverse) + position * inverse
        voxels = np.rint(scaled).astype(np.int64)
        low, high = self._view_box(depth_m, rays, rotation, position, 0.0)
        if len(voxels):
            low = np.minimum(low, voxels.min(axis=0))
            high = np.maximum(high, voxels.max(axis=0))
        self._grow(low, high)
        # What is seen of the sky frees the space that the grid has, but the grid does not grow into the sky.
        missing_m = self.config.carve_range_m if self.config.no_depth_is_free else 0.0
        low, high = self._view_box(depth_m, rays, rotation, position, missing_m)
        low = np.maximum(low, self._corner)
        high = np.minimum(high, self._corner + self._state.shape[::-1] - 1)
        self._carve(depth_m, intrinsics, rotation, position, low, high)
        self._mark(voxels, hit_depth)

    def state_at(self, points_m: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
        """State of the voxels that hold world points; UNKNOWN outside the grid."""
        return self.state_of(np.rint(points_m / self.config.voxel_m).astype(np.int64))

    def state_of(self, voxels: Int[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
        """State of voxels given by x, y, z index; UNKNOWN outside the grid."""
        inside, cells = self._cells(voxels)
        out = np.full(len(voxels), UNKNOWN, np.int8)
        out[inside] = self._state[cells]
        return out

    def _cells(self, voxels: Int[np.ndarray, "n 3"]) -> tuple[Bool[np.ndarray, " n"], tuple[np.ndarray, ...]]:
        """Which voxels, given by x, y, z index, lie in the grid, and the array indices of those that do."""
        x, y, z = (voxels - self._corner).T
        layers, rows, cols = self._state.shape
        inside = (x >= 0) & (x < cols) & (y >= 0) & (y < rows) & (z >= 0) & (z < layers)
        return inside, (z[inside], y[inside], x[inside])

    def observation_count(
        self,
        depth_m: Float32[np.ndarray, "h w"],
        intrinsics: Intrinsics,
        T_world_camera: Float[np.ndarray, "4 4"],
    ) -> UInt16[np.ndarray, "h w"]:
        """``num_hits`` of the voxel that each pixel of a depth image shows; 0 where it shows none of the grid."""
        inverse = np.float32(1.0 / self.config.voxel_m)
        rotation, position = T_world_camera[:3, :3].astype(np.float32), T_world_camera[:3, 3].astype(np.float32)
        rays = self._ray_directions(intrinsics).reshape(-1, 3)
        hit = np.flatnonzero((depth_m > 0.0) & (depth_m <= self.config.hit_range_m))
        scaled = (rays[hit] * depth_m.reshape(-1)[hit, None]) @ (rotation.T * inverse) + position * inverse
        inside, cells = self._cells(np.rint(scaled).astype(np.int64))
        out = np.zeros(depth_m.size, np.uint16)
        out[hit[inside]] = self._num_hits[cells]
        return out.reshape(depth_m.shape)

    def near_occupied(self, points_m: Float[np.ndarray, "n 3"], reach_m: float) -> Bool[np.ndarray, " n"]:
        """True for points with an occupied voxel within ``reach_m`` (less than half a voxel edge) along every axis."""
        low = np.rint((points_m - reach_m) / self.config.voxel_m).astype(np.int64)
        high = np.rint((points_m + reach_m) / self.config.voxel_m).astype(np.int64)
        near = np.zeros(len(points_m), bool)
        for corner in range(8):
            pick = np.array([corner & 1, corner >> 1 & 1, corner >> 2 & 1], bool)
            near |= self.state_of(np.where(pick, high, low)) == OCCUPIED
        return near

    @property
    def log_odds(self) -> Int8[np.ndarray, "layers rows cols"]:
        """Log-odds of each voxel being occupied, in tenths; 0 where never observed (a view)."""
        return self._log_odds

    def get_state(self) -> dict[str, np.ndarray]:
        """Copies of all arrays by name."""
        return {
            "corner": self._corner.copy(),
            "log_odds": self._log_odds.copy(),
            "state": self._state.copy(),
            "seen_range_m": self._seen_range_m.copy(),
            "num_hits": self._num_hits.copy(),
            "block_stamp": self._block_stamp.copy(),
            "num_frames": np.array(self._num_frames),
        }

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Take over what ``get_state`` gave."""
        self._corner = state["corner"].astype(np.int64)
        self._log_odds = state["log_odds"].astype(np.int8)
        self._state = state["state"].astype(np.int8)
        self._seen_range_m = state["seen_range_m"].astype(np.float32)
        self._num_hits = np.minimum(state["num_hits"], np.iinfo(np.uint16).max).astype(np.uint16)
        self._block_stamp = state["block_stamp"].astype(np.int32)
        self._num_frames = int(state["num_frames"])
        self._column_version = np.full(self._block_stamp.shape[1:], self._num_frames, np.int32)

    def _ray_directions(self, intrinsics: Intrinsics) -> Float32[np.ndarray, "h w 3"]:
        if self._rays is None or self._rays[0] != intrinsics:
            self._rays = (intrinsics, pixel_directions(intrinsics).astype(np.float32))
        return self._rays[1]

    def _view_box(
        self,
        depth_m: Float32[np.ndarray, "h w"],
        rays: Float32[np.ndarray, "h w 3"],
        rotation: Float32[np.ndarray, "3 3"],
        position: Float32[np.ndarray, "3"],
        missing_m: float,
    ) -> tuple[Int64[np.ndarray, "3"], Int64[np.ndarray, "3"]]:
        """Lowest and highest voxel of the box about the camera and all ray ends within the carving range.

        Rays that looked farther than the sensor's range end at ``missing_m``.
        """
        # Every fourth pixel tells the box to within a voxel or two, and what sticks out is carved by another frame.
        reach = np.nan_to_num(depth_m[::4, ::4], nan=0.0, posinf=missing_m).clip(0.0, self.config.carve_range_m)
        ends = (rays[::4, ::4] * reach[:, :, None]).reshape(-1, 3) @ rotation.T
        low = np.minimum(ends.min(axis=0), 0.0) + position
        high = np.maximum(ends.max(axis=0), 0.0) + position
        edge = self.config.voxel_m
        return np.floor(low / edge).astype(np.int64), np.ceil(high / edge).astype(np.int64)

    def _grow(self, low: Int64[np.ndarray, "3"], high: Int64[np.ndarray, "3"]) -> None:
        """Make room for voxels ``low`` to ``high`` (x, y, z, both included)."""
        shape = np.array(self._state.shape[::-1])
        if shape.all() and (low >= self._corner).all() and (high < self._corner + shape).all():
            return
        step = BLOCK * np.array([_PLANE_BLOCKS, _PLANE_BLOCKS, _LAYER_BLOCKS])
        new_low = np.floor_divide(low, step) * step
        new_high = (np.floor_divide(high, step) + 1) * step
        if shape.all():
            new_low = np.minimum(new_low, self._corner)
            new_high = np.maximum(new_high, self._corner + shape)
        before = (self._corner - new_low) if shape.all() else np.zeros(3, np.int64)
        new_shape = tuple((new_high - new_low)[::-1].tolist())
        start = before[::-1]
        self._log_odds = embed(self._log_odds, new_shape, start, 0)
        self._state = embed(self._state, new_shape, start, UNKNOWN)
        self._seen_range_m = embed(self._seen_range_m, new_shape, start, np.inf)
        self._num_hits = embed(self._num_hits, new_shape, start, 0)
        block_shape = tuple(n // BLOCK for n in new_shape)
        self._block_stamp = embed(self._block_stamp, block_shape, start // BLOCK, 0)
        self._column_version = embed(self._column_version, block_shape[1:], start[1:] // BLOCK, 0)
        self._corner = new_low

    def _carve(
        self,
        depth_m: Float32[np.ndarray, "h w"],
        intrinsics: Intrinsics,
        rotation: Float32[np.ndarray, "3 3"],
        position: Float32[np.ndarray, "3"],
        low: Int64[np.ndarray, "3"],
        high: Int64[np.ndarray, "3"],
    ) -> None:
        """Lower the log-odds of voxels in view that lie wholly in front of all depth in their footprint."""
        cfg = self.config
        edge = np.float32(cfg.voxel_m)
        height, width = depth_m.shape
        # Before the division by depth the projection is affine, so a column of voxels and a layer each add their share.
        x, y, z = (np.arange(low[a], high[a] + 1, dtype=np.float32) * edge - position[a] for a in range(3))
        column_shares = (rotation[0] * x[None, :, None] + rotation[1] * y[:, None, None]).reshape(-1, 3).T
        layer_shares = np.outer(rotation[2], z)
        footprint_px = np.float32(_FOOTPRINT * cfg.voxel_m * max(intrinsics.fx, intrinsics.fy))
        nearest = max(float(footprint_px) / (1 << _MAX_REACH), cfg.voxel_m)
        columns = _columns_in_view(column_shares, layer_shares, intrinsics, nearest, cfg.carve_range_m)
        right, down, planar = layer_shares[:, :, None] + column_shares[:, None, columns]
        with np.errstate(divide="ignore", invalid="ignore"):
            u = right * (np.float32(intrinsics.fx) / planar) + np.float32(intrinsics.cx)
            v = down * (np.float32(intrinsics.fy) / planar) + np.float32(intrinsics.cy)
        seen = (planar > nearest) & (planar < cfg.carve_range_m)
        seen &= (u >= 0.0) & (u < width) & (v >= 0.0) & (v < height)
        chosen = np.flatnonzero(seen)
        planar = planar.ravel()[chosen]
        pixel = v.ravel()[chosen].astype(np.int32) * width + u.ravel()[chosen].astype(np.int32)
        # The exponent of the footprint in pixels is the level of the pyramid whose window covers it.
        reach = np.frexp(footprint_px / planar)[1].clip(0, _MAX_REACH)
        pyramid = footprint_minima(_carve_limit(depth_m, cfg)).reshape(-1)
        in_front = planar + edge * np.float32(_HALF_DIAGONAL) < pyramid[reach * (height * width) + pixel]
        layer, column = np.divmod(chosen[in_front], len(columns))
        _, rows, cols = self._state.shape
        start = low - self._corner
        row, col = np.divmod(columns, len(x))
        flat_column = (row + start[1]) * cols + col + start[0]
        flat = (layer + start[2]) * (rows * cols) + flat_column[column]
        log_odds, state = self._log_odds.reshape(-1), self._state.reshape(-1)
        value = np.maximum(log_odds[flat], cfg.miss - cfg.limit) - np.int8(cfg.miss)
        log_odds[flat] = value
        carved = np.where(value > 0, np.int8(OCCUPIED), np.int8(FREE))
        self._note_change(flat[carved != state[flat]])
        state[flat] = carved

    def _mark(self, voxels: Int64[np.ndarray, "n 3"], depth_m: Float32[np.ndarray, " n"]) -> None:
        """Raise the log-odds of the voxels that were hit, once each, and note how often and from how near."""
        _, rows, cols = self._state.shape
        x, y, z = (voxels - self._corner).T
        flat = (z * rows + y) * cols + x
        seen = self._seen_range_m.reshape(-1)
        before = seen[flat]
        nearer = np.ceil(depth_m / SEEN_RANGE_STEP_M) < np.ceil(before / SEEN_RANGE_STEP_M)
        self._note_change(flat[nearer])
        # With several pixels in a voxel the last one counts: all are equally near, to within the voxel.
        seen[flat] = np.minimum(before, depth_m)
        flat, count = np.unique(flat, return_counts=True)
        hits = self._num_hits.reshape(-1)
        hits[flat] = np.minimum(hits[flat] + count, np.iinfo(np.uint16).max)
        log_odds, state = self._log_odds.reshape(-1), self._state.reshape(-1)
        value = np.minimum(log_odds[flat].astype(np.int16) + self.config.hit, self.config.limit).astype(np.int8)
        log_odds[flat] = value
        marked = np.where(value > 0, np.int8(OCCUPIED), np.int8(FREE))
        self._note_change(flat[marked != state[flat]])
        state[flat] = marked
        layer, rest = np.divmod(flat, rows * cols)
        row, col = np.divmod(rest, cols)
        self._block_stamp[layer // BLOCK, row // BLOCK, col // BLOCK] = self._num_frames

    def _note_change(self, flat: Int64[np.ndarray, " n"]) -> None:
        """Stamp the block columns of voxels that have changed, given by their index into the raveled arrays."""
        _, rows, cols = self._state.shape
        row, col = np.divmod(flat % (rows * cols), cols)
        self._column_version[row // BLOCK, col // BLOCK] = self._num_frames


def _columns_in_view(
    column_shares: Float32[np.ndarray, "3 columns"],
    layer_shares: Float32[np.ndarray, "3 layers"],
    intrinsics: Intrinsics,
    nearest_m: float,
    furthest_m: float,
) -> Int64[np.ndarray, " n"]:
    """Indices of voxel columns that may reach into the frustum's depth range and between its left and right sides."""
    left = intrinsics.cx / intrinsics.fx
    right = (intrinsics.width - intrinsics.cx) / intrinsics.fx
    # Each row is a plane with the frustum on its positive side, over (right, down, planar), and its offset.
    planes = np.array([[0, 0, 1], [0, 0, -1], [1, 0, left], [-1, 0, right]], np.float32)
    offsets = np.array([-nearest_m, furthest_m, 0.0, 0.0], np.float32)
    best_layer = (planes @ layer_shares).max(axis=1)
    return np.flatnonzero((planes @ column_shares + (best_layer + offsets)[:, None] > 0.0).all(axis=0))


def footprint_minima(depth_m: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "levels h w"]:
    """Smallest depth within 1, 2, 4, 8, 16 pixels of each pixel along both axes."""
    levels = [_spread(depth_m, 1)]
    for level in range(_MAX_REACH):
        levels.append(_spread(levels[-1], 1 << level))
    return np.stack(levels)


def _spread(image: Float32[np.ndarray, "h w"], shift: int) -> Float32[np.ndarray, "h w"]:
    out = image.copy()
    np.minimum(out[shift:], image[:-shift], out=out[shift:])
    np.minimum(out[:-shift], image[shift:], out=out[:-shift])
    rows = out.copy()
    np.minimum(out[:, shift:], rows[:, :-shift], out=out[:, shift:])
    np.minimum(out[:, :-shift], rows[:, shift:], out=out[:, :-shift])
    return out


def _carve_limit(depth_m: Float32[np.ndarray, "h w"], config: OccupancyConfig) -> Float32[np.ndarray, "h w"]:
    """Depth up to which each pixel vouches for free space [m].

    A pixel that was not measured vouches as far as the nearest of the measured ones beside it, and for nothing where
    there is none: what is missing at an edge belongs to the near or to the far surface.
    """
    measured = depth_m > 0.0
    limit = np.where(measured, depth_m, np.float32(np.inf))
    if not config.no_depth_is_free:
        limit[np.isposinf(depth_m)] = 0.0
    if not measured.all():
        nearest = _spread(limit, 1)
        beside = _spread(np.where(measured, np.float32(0.0), np.float32(1.0)), 1) == 0.0
        limit = np.where(measured, limit, np.where(beside, nearest, np.float32(0.0)))
    return limit
