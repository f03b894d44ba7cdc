"""The occupancy grid's kernels in C++ (``native/occupancy.cpp``), on all cores: the same grids as NumPy's, bit by bit.

They are part of the native engine, but an engine that was built before they were made lacks them; then NumPy's run.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from jaxtyping import Float32, Int64, UInt16

from anm_mj.mapping.mapping_config import OccupancyConfig
from anm_mj.mapping.occupancy_kernels import (
    FOOTPRINT,
    HALF_DIAGONAL,
    MAX_REACH,
    SEEN_RANGE_STEP_M,
    CameraView,
    VoxelArrays,
    to_voxels,
)
from anm_mj.utils.threads import usual_num_threads


class NativeFusion:
    """What :class:`anm_mj.mapping.occupancy_kernels.NumpyFusion` does."""

    def __init__(self, kernels: Any) -> None:
        """Wrap an ``_native.Occupancy``."""
        self._kernels = kernels

    def hits(
        self, view: CameraView, config: OccupancyConfig, first: tuple[int, int], stride: int
    ) -> tuple[Int64[np.ndarray, "n 3"], Float32[np.ndarray, " n"]]:
        """The voxels that pixels hit; see the reference."""
        depth_m, rays, matrix, offset = _rays(view, config)
        most = -(-depth_m.shape[0] // stride) * -(-depth_m.shape[1] // stride)
        voxels, hit_depth = np.empty((most, 3), np.int64), np.empty(most, np.float32)
        count = self._kernels.hits(depth_m, rays, *first, stride, config.hit_range_m, matrix, offset, voxels, hit_depth)
        return voxels[:count], hit_depth[:count]

    def counts(self, voxels: VoxelArrays, view: CameraView, config: OccupancyConfig) -> UInt16[np.ndarray, "h w"]:
        """Hits so far in the voxel that each pixel shows; see the reference."""
        depth_m, rays, matrix, offset = _rays(view, config)
        self._kernels.bind(*voxels)
        out = np.empty(depth_m.shape, np.uint16)
        self._kernels.counts(depth_m, rays, config.hit_range_m, matrix, offset, out)
        return out

    def carve(
        self,
        voxels: VoxelArrays,
        view: CameraView,
        config: OccupancyConfig,
        low: Int64[np.ndarray, "3"],
        high: Int64[np.ndarray, "3"],
        frame: int,
    ) -> None:
        """Lower the log-odds of voxels that were looked through; see the reference."""
        pinhole = view.intrinsics
        footprint_px = np.float32(FOOTPRINT * config.voxel_m * max(pinhole.fx, pinhole.fy))
        self._kernels.bind(*voxels)
        self._kernels.carve(
            np.ascontiguousarray(view.depth_m),
            pinhole.fx,
            pinhole.fy,
            pinhole.cx,
            pinhole.cy,
            np.ascontiguousarray(view.rotation).reshape(-1),
            view.position,
            low,
            high,
            config.voxel_m,
            float(np.float32(config.voxel_m) * np.float32(HALF_DIAGONAL)),
            float(footprint_px),
            max(float(footprint_px) / (1 << MAX_REACH), config.voxel_m),
            config.carve_range_m,
            config.miss,
            config.limit,
            config.no_depth_is_free,
            frame,
        )

    def mark(
        self,
        voxels: VoxelArrays,
        places: Int64[np.ndarray, "n 3"],
        depth_m: Float32[np.ndarray, " n"],
        config: OccupancyConfig,
        frame: int,
    ) -> None:
        """Raise the log-odds of the voxels that were hit; see the reference."""
        self._kernels.bind(*voxels)
        self._kernels.mark(places, depth_m, SEEN_RANGE_STEP_M, config.hit, config.limit, frame)


def native_fusion(num_threads: int | None = None, kernel: str = "") -> NativeFusion | None:
    """The native kernels; None where they were not built.

    Args:
        num_threads: threads to compute with; None = as many as there are cores, or as ``OMP_NUM_THREADS`` says. The
            results do not depend on it.
        kernel: instruction set to use; empty for the best of this processor.
    """
    try:
        native = importlib.import_module("anm_mj._native")
    except ImportError:
        return None
    if not hasattr(native, "Occupancy") or not native.kernel_names():
        return None
    return NativeFusion(native.Occupancy(num_threads or usual_num_threads(), kernel))


def _rays(
    view: CameraView, config: OccupancyConfig
) -> tuple[
    Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w 3"], Float32[np.ndarray, " nine"], Float32[np.ndarray, "3"]
]:
    matrix, offset = to_voxels(view, config.voxel_m)
    return np.ascontiguousarray(view.depth_m), view.rays, matrix.reshape(-1), offset
