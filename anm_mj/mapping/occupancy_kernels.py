"""The kernels of the occupancy grid, in C++ (``native/occupancy.cpp``).

They run on all cores; their results depend neither on the number of cores nor on the instruction set.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int8, Int32, Int64, UInt8, UInt16

from anm_mj import _native
from anm_mj.mapping.mapping_config import OccupancyConfig
from anm_mj.types import FREE, UNKNOWN, Intrinsics
from anm_mj.utils.read_file import array_of
from anm_mj.utils.threads import usual_num_threads

BLOCK = 16
"""Voxels along the edge of a block, the unit of growth and of change."""
SEEN_RANGE_STEP_M = 1.0
"""How much nearer a voxel must have been seen to count as changed: readers compare with whole metres [m]."""
FOOTPRINT = 0.7
"""Half width in voxel edges of what counts as a voxel's footprint: half the diagonal of a face."""
HALF_DIAGONAL = 0.5 * math.sqrt(3.0)
"""Half the diagonal of a voxel, in voxel edges."""
MAX_REACH = 4
"""Levels of the footprint pyramid beyond the first; the last spans 33 pixels."""

KNOWN_HITS = 2
"""A voxel that was hit more often than looked through, by so many frames, holds surface that is known."""
SUPPORT = 4
"""Neighbours of a moved pixel that must contradict the grid, too; edges of depth make single pixels that do."""
REACH_M = 0.6
"""What hangs together with contradicting pixels counts up to this far from them [m]."""
APART_M, APART_SHARE = 0.06, 0.03
"""Neighbouring pixels hang together whose depths differ by less than either."""
NOWHERE = np.zeros((0, 0), np.uint8)
FARTHEST_CELL = 1 << 21
"""Voxels lie within this number of voxels about the origin: beyond it, the numbers of 32 bits that places are computed
in lie more than an eighth of a voxel apart."""

Voxels = Int64[np.ndarray, "n 3"]
"""x, y, z index of voxels."""


class VoxelArrays(NamedTuple):
    """The arrays of an occupancy grid, which the kernels change in place."""

    log_odds: Int8[np.ndarray, "layers rows cols"]
    state: Int8[np.ndarray, "layers rows cols"]
    seen_range_m: Float32[np.ndarray, "layers rows cols"]
    num_hits: UInt16[np.ndarray, "layers rows cols"]
    block_stamp: Int32[np.ndarray, "block_layers block_rows block_cols"]
    column_version: Int32[np.ndarray, "block_rows block_cols"]
    corner: Int64[np.ndarray, "3"]
    """x, y, z index of cell [0, 0, 0]."""

    def cells_of(self, places: Int[np.ndarray, "n 3"]) -> tuple[Bool[np.ndarray, " n"], tuple[np.ndarray, ...]]:
        """Which voxels, given by x, y, z index, lie in the grid, and the array indices of those that do."""
        x, y, z = (places - self.corner).T
        layers, rows, cols = self.state.shape
        inside = (x >= 0) & (x < cols) & (y >= 0) & (y < rows) & (z >= 0) & (z < layers)
        return inside, (z[inside], y[inside], x[inside])

    def take_over(self, part: VoxelArrays) -> None:
        """Take over what a smaller grid holds, which lies within this one."""
        start = (part.corner - self.corner)[::-1]
        block = start // BLOCK
        for array, smaller, first in zip(self, part, (*[start] * 4, block, block[1:]), strict=False):
            array[tuple(slice(a, a + n) for a, n in zip(first, smaller.shape, strict=True))] = smaller

    def free(self, places: Int[np.ndarray, "n 3"], log_odds: int, frame: int) -> None:
        """Make voxels, given by x, y, z index, free with these log-odds; those that are free stay as they are."""
        _, cells = self.cells_of(places)
        other = self.state[cells] != FREE
        self.change(tuple(axis[other] for axis in cells), FREE, log_odds, frame)

    def change(
        self, cells: tuple[np.ndarray, ...], state: int, log_odds: Int8[np.ndarray, " n"] | int, frame: int
    ) -> None:
        """Give voxels, by their array indices, another state, which readers find from ``frame`` on."""
        _, row, col = cells
        self.log_odds[cells] = log_odds
        self.state[cells] = state
        self.column_version[row // BLOCK, col // BLOCK] = frame


def unseen_voxels(shape: tuple[int, ...], corner: Int64[np.ndarray, "3"]) -> VoxelArrays:
    """The arrays of a grid of so many layers, rows and columns, whole blocks each, of which nothing was observed."""
    blocks = tuple(side // BLOCK for side in shape)
    return VoxelArrays(
        log_odds=np.zeros(shape, np.int8),
        state=np.full(shape, UNKNOWN, np.int8),
        seen_range_m=np.full(shape, np.inf, np.float32),
        num_hits=np.zeros(shape, np.uint16),
        block_stamp=np.zeros(blocks, np.int32),
        column_version=np.zeros(blocks[1:], np.int32),
        corner=corner,
    )


class DepthFrame(NamedTuple):
    """A posed depth image, as it comes: see :meth:`~.depth_occupancy.DepthOccupancy.integrate`."""

    depth_m: Float32[np.ndarray, "h w"]
    intrinsics: Intrinsics
    T_world_camera: Float[np.ndarray, "4 4"]
    range_m: float = math.inf
    moved_m: Float32[np.ndarray, "h w"] | None = None


class CameraView(NamedTuple):
    """One depth image and where it was taken."""

    depth_m: Float32[np.ndarray, "h w"]
    rays: Float32[np.ndarray, "h w 3"]
    """Through the pixels' centres in camera axes, scaled to z = 1."""
    intrinsics: Intrinsics
    rotation: Float32[np.ndarray, "3 3"]
    """Camera to world."""
    position: Float32[np.ndarray, "3"]
    """In the world [m]."""

    def to_voxels(self, voxel_m: float) -> tuple[Float32[np.ndarray, "3 3"], Float32[np.ndarray, "3"]]:
        """Matrix and offset that turn points in camera axes [m] into places in the world in voxel edges."""
        inverse = np.float32(1.0 / voxel_m)
        return np.ascontiguousarray(self.rotation.T * inverse), self.position * inverse


class OccupancyKernels:
    """What changes and reads the arrays of a grid."""

    def __init__(self, config: OccupancyConfig, num_threads: int | None = None, kernel: str = "") -> None:
        """Make the kernels. ``num_threads`` None = one per core, or as ``OMP_NUM_THREADS`` says; ``kernel`` is the
        instruction set, empty for the best of this processor.
        """
        self._config = config
        self._native = _native.Occupancy(num_threads or usual_num_threads(), kernel)

    def hits(self, view: CameraView, first: tuple[int, int], stride: int) -> tuple[Voxels, Float32[np.ndarray, " n"]]:
        """The voxels that pixels hit and their depth [m], of every ``stride``-th row and column from ``first`` on."""
        depth_m = np.ascontiguousarray(view.depth_m)
        matrix, offset = view.to_voxels(self._config.voxel_m)
        most = -(-depth_m.shape[0] // stride) * -(-depth_m.shape[1] // stride)
        voxels, hit_depth = np.empty((most, 3), np.int64), np.empty(most, np.float32)
        limit_m = self._config.hit_range_m
        count = self._native.hits(
            depth_m, view.rays, *first, stride, limit_m, matrix.reshape(-1), offset, voxels, hit_depth
        )
        return voxels[:count], hit_depth[:count]

    def counts(self, voxels: VoxelArrays, view: CameraView) -> UInt16[np.ndarray, "h w"]:
        """Hits so far in the voxel that each pixel shows; 0 where it shows none of the grid."""
        depth_m = np.ascontiguousarray(view.depth_m)
        matrix, offset = view.to_voxels(self._config.voxel_m)
        self._native.bind(*voxels)
        out = np.empty(depth_m.shape, np.uint16)
        self._native.counts(depth_m, view.rays, self._config.hit_range_m, matrix.reshape(-1), offset, out)
        return out

    def carve(
        self,
        voxels: VoxelArrays,
        view: CameraView,
        low: Int64[np.ndarray, "3"],
        high: Int64[np.ndarray, "3"],
        frame: int,
        heavy: UInt8[np.ndarray, "_ _"] = NOWHERE,
    ) -> None:
        """Lower the log-odds of voxels in view that lie wholly in front of all depth in their footprint.

        Looked at is the box from voxel ``low`` to ``high`` (x, y, z, both included), which lies within the grid;
        changed blocks are stamped with ``frame``. In ``heavy`` columns of blocks looking through counts as much as a
        hit; empty for none.
        """
        config, pinhole = self._config, view.intrinsics
        footprint_px = np.float32(FOOTPRINT * config.voxel_m * max(pinhole.fx, pinhole.fy))
        self._native.bind(*voxels)
        self._native.carve(
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
            heavy,
            config.hit,
        )

    def free_left(
        self, voxels: VoxelArrays, heavy: UInt8[np.ndarray, "_ _"], heights: tuple[int, int], frame: int
    ) -> None:
        """Free what is left of things that have gone (``native/moved_pixels.h``), in what a frame has carved: in
        ``heavy`` columns of blocks, at z indices from the first of ``heights`` up to, not including, the second.
        """
        low, high = (height - int(voxels.corner[2]) for height in heights)
        self._native.bind(*voxels)
        self._native.free_left(heavy, low, high, self._config.miss, frame)

    def moved(
        self, voxels: VoxelArrays, view: CameraView, doubt: tuple[float, float, float], free_looks: int
    ) -> Bool[np.ndarray, "h w"]:
        """The pixels that show what was not there before (:mod:`anm_mj.mapping.moved_pixels`). Depth may be too short
        by ``doubt``, as :func:`anm_mj.mapping.moved_pixels.depth_doubt` has it; ``free_looks`` frames more looked
        through surely free voxels than hit them.
        """
        config = self._config
        matrix, offset = view.to_voxels(config.voxel_m)
        self._native.bind(*voxels)
        out = np.empty(view.depth_m.shape, np.uint8)
        self._native.moved(
            np.ascontiguousarray(view.depth_m),
            view.rays,
            matrix.reshape(-1),
            offset,
            config.voxel_m,
            *doubt,
            config.hit_range_m,
            -free_looks * config.miss,
            KNOWN_HITS * config.hit,
            SUPPORT,
            REACH_M,
            max(view.intrinsics.fx, view.intrinsics.fy),
            APART_M,
            APART_SHARE,
            out,
        )
        return out.view(bool)

    def mark(self, voxels: VoxelArrays, places: Voxels, depth_m: Float32[np.ndarray, " n"], frame: int) -> None:
        """Raise the log-odds of the voxels that were hit, once each, and note how often and from how near. ``places``,
        within the grid, and ``depth_m``, planar [m], are those of the pixels; changed blocks are stamped with
        ``frame``.
        """
        self._native.bind(*voxels)
        self._native.mark(places, depth_m, SEEN_RANGE_STEP_M, self._config.hit, self._config.limit, frame)


def check_arrays(state: dict[str, np.ndarray]) -> None:
    """Raises ValueError for arrays of a file that are no grid."""
    shape = array_of(state, "log_odds", "i", (None, None, None)).shape
    for name, kinds in (("state", "i"), ("num_hits", "iu")):
        array_of(state, name, kinds, shape)
    seen = state.get("seen_range_m")
    if seen is None or seen.dtype.kind != "f" or seen.shape != shape or np.isnan(seen).any():
        raise ValueError("seen_range_m does not fit log_odds")
    corner = array_of(state, "corner", "i", (3,))
    array_of(state, "block_stamp", "i", tuple(cells // BLOCK for cells in shape))
    whole = not any(cells % BLOCK for cells in (*shape, *corner.tolist()))
    if not whole or np.abs(corner.astype(float)).max() > FARTHEST_CELL:
        raise ValueError(f"a grid of {shape} voxels begins at {corner.tolist()}")
    # The frames to come are counted in 32 bits, too.
    if not 0 <= int(array_of(state, "num_frames", "iu", ())) <= 10**9:
        raise ValueError(f"num_frames is {state['num_frames']}")
    for name, sizes in (("depth_noise", (3, 4)), ("strays", (2,))):
        # Maps of older versions have no strays, and no fourth figure of noise.
        noise = array_of({"strays": np.zeros(2), **state}, name, "f", (None,))
        if len(noise) not in sizes or not (noise >= 0.0).all():
            raise ValueError(f"{name} is {noise.tolist()}")
