"""The occupancy kernels in NumPy: the reference of ``native/occupancy.cpp``.

Every product is rounded to single precision before it is added to and all sums run in one order, so that both give the
same grid to the last bit.
"""

import numpy as np
from jaxtyping import Float32, Int64, UInt8, UInt16

from anm_mj.mapping.mapping_config import OccupancyConfig
from anm_mj.mapping.occupancy_kernels import (
    BLOCK,
    FOOTPRINT,
    HALF_DIAGONAL,
    MAX_REACH,
    NOWHERE,
    SEEN_RANGE_STEP_M,
    CameraView,
    VoxelArrays,
)
from anm_mj.types import FREE, OCCUPIED, Intrinsics

_VIEW_MARGIN_M = 1e-3
"""Columns this far out of view are looked at all the same: a voxel at the rim is judged by its pixel alone [m]."""


class NumpyKernels:
    """The kernels of an occupancy grid."""

    def __init__(self, config: OccupancyConfig) -> None:
        self._config = config

    def hits(
        self, view: CameraView, first: tuple[int, int], stride: int
    ) -> tuple[Int64[np.ndarray, "n 3"], Float32[np.ndarray, " n"]]:
        """The voxels (x, y, z) that pixels hit and their depth [m], of every ``stride``-th row and column."""
        config = self._config
        pick = slice(first[0], None, stride), slice(first[1], None, stride)
        depth_m = view.depth_m[pick]
        hit = (depth_m > 0.0) & (depth_m <= config.hit_range_m)
        depth_m = depth_m[hit]
        return _voxels_of(view.rays[pick][hit], depth_m, view, config), depth_m

    def counts(self, voxels: VoxelArrays, view: CameraView) -> UInt16[np.ndarray, "h w"]:
        """Hits so far in the voxel that each pixel shows; 0 where it shows none of the grid."""
        config = self._config
        hit = np.flatnonzero((view.depth_m > 0.0) & (view.depth_m <= config.hit_range_m))
        places = _voxels_of(view.rays.reshape(-1, 3)[hit], view.depth_m.reshape(-1)[hit], view, config)
        inside, cells = voxels.cells_of(places)
        out = np.zeros(view.depth_m.size, np.uint16)
        out[hit[inside]] = voxels.num_hits[cells]
        return out.reshape(view.depth_m.shape)

    def carve(
        self,
        voxels: VoxelArrays,
        view: CameraView,
        low: Int64[np.ndarray, "3"],
        high: Int64[np.ndarray, "3"],
        frame: int,
        heavy: UInt8[np.ndarray, "_ _"] = NOWHERE,
    ) -> None:
        """Lower the log-odds of voxels in view that lie wholly in front of all depth in their footprint."""
        if (high < low).any():
            return
        cfg, (depth_m, _, intrinsics, rotation, position) = self._config, view
        edge = np.float32(cfg.voxel_m)
        height, width = depth_m.shape
        # Before the division by depth the projection is affine, so a column of voxels and a layer each add their share.
        x, y, z = (np.arange(low[a], high[a] + 1, dtype=np.float32) * edge - position[a] for a in range(3))
        column_shares = (rotation[0] * x[None, :, None] + rotation[1] * y[:, None, None]).reshape(-1, 3).T
        layer_shares = np.outer(rotation[2], z)
        footprint_px = np.float32(FOOTPRINT * cfg.voxel_m * max(intrinsics.fx, intrinsics.fy))
        nearest = max(float(footprint_px) / (1 << MAX_REACH), cfg.voxel_m)
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
        reach = np.frexp(footprint_px / planar)[1].clip(0, MAX_REACH)
        pyramid = footprint_minima(_carve_limit(depth_m, cfg)).reshape(-1)
        in_front = planar + edge * np.float32(HALF_DIAGONAL) < pyramid[reach * (height * width) + pixel]
        layer, column = np.divmod(chosen[in_front], len(columns))
        _, rows, cols = voxels.state.shape
        start = low - voxels.corner
        row, col = np.divmod(columns, len(x))
        flat_column = (row + start[1]) * cols + col + start[0]
        flat = (layer + start[2]) * (rows * cols) + flat_column[column]
        log_odds, state = voxels.log_odds.reshape(-1), voxels.state.reshape(-1)
        weight = np.full(len(flat), cfg.miss, np.int64)
        if heavy.size:
            block_row, block_col = (row + start[1]) // BLOCK, (col + start[0]) // BLOCK
            weight[heavy[block_row[column], block_col[column]] != 0] = cfg.hit
        value = (np.maximum(log_odds[flat], weight - cfg.limit) - weight).astype(np.int8)
        log_odds[flat] = value
        carved = np.where(value > 0, np.int8(OCCUPIED), np.int8(FREE))
        _note_change(voxels, flat[carved != state[flat]], frame)
        state[flat] = carved

    def mark(
        self,
        voxels: VoxelArrays,
        places: Int64[np.ndarray, "n 3"],
        depth_m: Float32[np.ndarray, " n"],
        frame: int,
    ) -> None:
        """Raise the log-odds of the voxels that were hit, once each, and note how often and from how near."""
        config = self._config
        _, rows, cols = voxels.state.shape
        x, y, z = (places - voxels.corner).T
        flat = (z * rows + y) * cols + x
        seen = voxels.seen_range_m.reshape(-1)
        nearer = np.ceil(depth_m / SEEN_RANGE_STEP_M) < np.ceil(seen[flat] / SEEN_RANGE_STEP_M)
        _note_change(voxels, flat[nearer], frame)
        np.minimum.at(seen, flat, depth_m)
        flat, count = np.unique(flat, return_counts=True)
        hits = voxels.num_hits.reshape(-1)
        hits[flat] = np.minimum(hits[flat] + count, np.iinfo(np.uint16).max)
        log_odds, state = voxels.log_odds.reshape(-1), voxels.state.reshape(-1)
        value = np.minimum(log_odds[flat].astype(np.int16) + config.hit, config.limit).astype(np.int8)
        log_odds[flat] = value
        marked = np.where(value > 0, np.int8(OCCUPIED), np.int8(FREE))
        _note_change(voxels, flat[marked != state[flat]], frame)
        state[flat] = marked
        layer, rest = np.divmod(flat, rows * cols)
        row, col = np.divmod(rest, cols)
        voxels.block_stamp[layer // BLOCK, row // BLOCK, col // BLOCK] = frame


def _voxels_of(
    rays: Float32[np.ndarray, "n 3"], depth_m: Float32[np.ndarray, " n"], view: CameraView, config: OccupancyConfig
) -> Int64[np.ndarray, "n 3"]:
    matrix, offset = view.to_voxels(config.voxel_m)
    point = rays * depth_m[:, None]
    # Not a matrix product: libraries sum in an order of their own.
    scaled = point[:, :1] * matrix[0] + point[:, 1:2] * matrix[1] + point[:, 2:] * matrix[2] + offset
    return np.rint(scaled).astype(np.int64)


def _note_change(voxels: VoxelArrays, flat: Int64[np.ndarray, " n"], frame: int) -> None:
    """Stamp the block columns of voxels that have changed, given by their index into the raveled arrays."""
    _, rows, cols = voxels.state.shape
    row, col = np.divmod(flat % (rows * cols), cols)
    voxels.column_version[row // BLOCK, col // BLOCK] = frame


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
    return np.flatnonzero((planes @ column_shares + (best_layer + offsets)[:, None] > -_VIEW_MARGIN_M).all(axis=0))


def footprint_minima(depth_m: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "levels h w"]:
    """Smallest depth within 1, 2, 4, 8, 16 pixels of each pixel along both axes."""
    levels = [_spread(depth_m, 1)]
    for level in range(MAX_REACH):
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
