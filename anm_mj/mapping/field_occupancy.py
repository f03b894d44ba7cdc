"""Free and occupied space as the neural field has it, wherever something was observed.

The occupancy grid knows what has been observed; the field knows where the surface is. A grid of raw depth puts an
obstacle wherever noise ever put a pixel, while the field averages the noise of all views. So every voxel that holds a
hit, and every observed voxel beside one, is read from the field.

A hit is dismissed only where the field says that the surface passes the voxel by *and* the sensor's noise explains
how the hit came there. The noise is learnt from the images (:mod:`anm_mj.mapping.depth_noise`), and the smallest depth
at which the voxel was hit says how far it reaches. So with exact depth every hit stands, also where the field has not
learnt a chair's leg or the top of a bed yet, and with a noisy sensor the field decides. Likewise a free voxel beside a
hit is occupied where its centre lies in the solid and the noise explains how a ray came to pass it. What no depth ever
hit stays free or unknown, because a field extrapolates any sign it likes there.

Where single pixels of the sensor stray (:class:`~anm_mj.mapping.stray_pixels.Strays`), no distance is too far for a hit
of few pixels: the field decides on those at any depth.

What moves is held for an obstacle without any hit, and surface is doubted against its hits
(:mod:`anm_mj.mapping.moved_pixels`): whatever the sensor is like, the field does not decide on either.

A block in view changes with every frame, but most of its voxels only because the field has learnt a little more. Where
depth and field agreed so far, the field is therefore asked in every third reading of a block alone, the blocks in turn.
"""

import math
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int8, Int32, Int64

from anm_mj.mapping.depth_noise import EXACT_PER_M
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.field_blocks import DoubtRule, decide_voxels, voxel_centres, voxels_to_read, write_blocks
from anm_mj.mapping.occupancy_kernels import BLOCK, HALF_DIAGONAL
from anm_mj.types import FREE, UNKNOWN, OccupancyGrid, SdfQuery
from anm_mj.utils.arrays import embed

HIT_SHARE = 0.75
"""The surface passes a voxel by where the signed distance at its centre is more than this share of its edge. A surface
in the voxel lies within half an edge of the centre if it faces an axis, within 0.87 if it faces a corner; a floor one
layer below lies a whole edge away."""
NOISE_REACH = 8.0
"""Noise explains a hit that lies within so many standard deviations of the surface: of the millions of pixels that fall
near a surface, the farthest is what an obstacle is made of."""
STRAY_PIXELS = 2
"""So many pixels in a voxel, of all frames, may have strayed there: more seldom come together by chance."""
_NOISE_CHANGE = 1.1
"""All blocks are read again when the noise turns out larger or smaller by this factor."""
_READINGS_PER_TURN = 3
"""A block is read as a whole once in so many readings."""

_NOTHING = np.zeros(0, np.int64), np.zeros(0, np.int8)
"""No voxel that the field decides."""


class FieldOccupancy:
    """Keeps the states of all observed voxels in step with the field, block by block, where frames came in."""

    def __init__(self, by_depth: DepthOccupancy) -> None:
        """Start with nothing read of what has been observed."""
        self._by_depth = by_depth
        self._corner: Int64[np.ndarray, "3"] = np.zeros(3, np.int64)
        self._state: Int8[np.ndarray, "layers rows cols"] = np.zeros((0, 0, 0), np.int8)
        self._column_version: Int32[np.ndarray, "block_rows block_cols"] = np.zeros((0, 0), np.int32)
        self._read_frame: Int32[np.ndarray, "block_layers block_rows block_cols"] = np.zeros((0, 0, 0), np.int32)
        self._whole_frame = self._read_frame.copy()
        """Frame of each block's last reading as a whole; 0 for none."""
        self._turn: Int8[np.ndarray, "block_layers block_rows block_cols"] = np.zeros((0, 0, 0), np.int8)
        """Readings of each block until it is read as a whole again."""
        self._read_up_to = 0
        self._noise_per_m = math.inf
        self._strays = False

    def grid(self, sdf_m: SdfQuery, box_xy_m: Float[np.ndarray, "2 2"] | None = None) -> OccupancyGrid:
        """Free, occupied and unknown space as of now, by the signed distance at world points (N, 3) [m], positive in
        free space. Outside of a box, given by its lower and upper corner in the world [m], the grid may be that of an
        earlier reading; None = the whole grid is of now.
        """
        depth_grid = self._by_depth.grid
        self._follow_growth(depth_grid)
        if self._read_up_to < depth_grid.version:
            self._follow_noise()
            self._read(depth_grid, sdf_m, box_xy_m)
            self._read_up_to = depth_grid.version if box_xy_m is None else self._read_up_to
        return replace(depth_grid, state=self._state, column_version=self._column_version)

    def _read(self, depth_grid: OccupancyGrid, sdf_m: SdfQuery, box_xy_m: Float[np.ndarray, "2 2"] | None) -> None:
        """Read the blocks again that any frame since their last reading changed or had a hit in."""
        assert depth_grid.column_version is not None  # The occupancy grid keeps track.
        rows, cols = self._block_window(depth_grid, box_xy_m)
        near = np.zeros(self._read_frame.shape, np.bool_)
        near[:, rows, cols] = True
        stamp = self._by_depth.voxels.block_stamp
        changed = near & (depth_grid.column_version > self._read_frame)
        # The last frame of a block that has left the view is one to read it as a whole after.
        blocks = changed | (near & (stamp > self._whole_frame))
        if not blocks.any():
            return
        self._read_frame[blocks] = depth_grid.version
        self._turn[blocks] -= 1
        first = blocks & (self._whole_frame == 0)
        whole = first | (blocks & (self._turn < 0))
        moved = self._read_blocks(np.argwhere(whole), depth_grid, sdf_m, whole=True)
        moved = np.concatenate([moved, self._read_blocks(np.argwhere(blocks & ~whole), depth_grid, sdf_m, whole=False)])
        self._whole_frame[whole] = depth_grid.version
        self._turn[whole] = _READINGS_PER_TURN - 1
        # Blocks that came into view together are not all read as a whole in the same decision ever after.
        self._turn[first] = np.argwhere(first).sum(axis=1) % _READINGS_PER_TURN
        self._column_version[changed.any(axis=0)] = depth_grid.version
        self._column_version[moved[:, 1], moved[:, 2]] = depth_grid.version

    def _read_blocks(
        self, places: Int64[np.ndarray, "m 3"], depth_grid: OccupancyGrid, sdf_m: SdfQuery, *, whole: bool
    ) -> Int64[np.ndarray, "k 3"]:
        """Read blocks, given by layer, row and column, and return those in which a state has changed. The field is
        asked where it agreed with the depth so far only if they are to be read as a ``whole``.
        """
        if not len(places):
            return places
        asks = self._noise_per_m > 0.0 or self._strays
        voxels, read = self._ask_field(places, depth_grid, sdf_m, whole=whole) if asks else _NOTHING
        return places[write_blocks(depth_grid.state, places, voxels, read, self._state)]

    def _ask_field(
        self, places: Int64[np.ndarray, "m 3"], depth_grid: OccupancyGrid, sdf_m: SdfQuery, *, whole: bool
    ) -> tuple[Int64[np.ndarray, " n"], Int8[np.ndarray, " n"]]:
        """Decide the hits in blocks, and what was observed beside them, by the field; see :meth:`_read_blocks`. Returns
        indices of these voxels into the raveled grid, block by block, and their states.
        """
        has_hits = self._by_depth.voxels.block_stamp[tuple(places.T)] > 0
        voxels = voxels_to_read(depth_grid.state, places[has_hits], None if whole else self._state)
        # The field has learnt nothing of what is held, and what is doubted with the rest.
        voxels = voxels[~self._by_depth.is_pretended(voxels)]
        points_m = voxel_centres(voxels, depth_grid.state.shape, self._corner, depth_grid.resolution_m)
        noise_per_m = np.float32(NOISE_REACH * self._noise_per_m)
        rule = DoubtRule(
            hit_m=HIT_SHARE * depth_grid.resolution_m,
            half_m=0.5 * depth_grid.resolution_m,
            noise_per_m=float(noise_per_m),
            passed_m=HALF_DIAGONAL * depth_grid.resolution_m,
            ray_reach_m=float(noise_per_m * np.float32(self._by_depth.config.carve_range_m) ** 2),
        )
        distance_m = sdf_m(points_m)
        states = decide_voxels(depth_grid.state, depth_grid.seen_range_m, voxels, distance_m, rule)
        if self._strays:
            few = self._by_depth.voxels.num_hits.reshape(-1)[voxels] <= STRAY_PIXELS
            states[few & (distance_m > rule.hit_m)] = FREE
        return voxels, states

    def _follow_noise(self) -> None:
        """Start over where the sensor turns out to be another one than what was read says."""
        noise = self._by_depth.noise
        # What exact depth says stands, and the field is not asked.
        noise, strays = 0.0 if noise.value < EXACT_PER_M else noise.rough, self._by_depth.strays.are_known
        changed = max(noise, self._noise_per_m) > _NOISE_CHANGE * min(noise, self._noise_per_m)
        if changed or strays != self._strays:
            self._noise_per_m, self._strays = noise, strays
            self._read_frame.fill(0)
            self._whole_frame.fill(0)

    def _block_window(
        self, depth_grid: OccupancyGrid, box_xy_m: Float[np.ndarray, "2 2"] | None
    ) -> tuple[slice, slice]:
        """Rows and columns of the blocks that touch a box, give or take two voxels."""
        if box_xy_m is None:
            return slice(None), slice(None)
        around_m = 2.0 * depth_grid.resolution_m * np.array([[-1.0], [1.0]])
        low, high = (box_xy_m + around_m - depth_grid.origin_m[:2]) / (BLOCK * depth_grid.resolution_m)
        # A box may reach to infinity, which is no whole number.
        low, high = (
            np.clip(edge, 0, self._read_frame.shape[:0:-1]).astype(int) for edge in (np.floor(low), np.ceil(high))
        )
        return slice(low[1], high[1]), slice(low[0], high[0])

    def _follow_growth(self, depth_grid: OccupancyGrid) -> None:
        """Keep the states aligned with a grid that has grown."""
        if self._state.shape == depth_grid.state.shape:
            return
        corner = self._by_depth.voxels.corner
        start = (self._corner - corner)[::-1] if self._state.size else np.zeros(3, np.int64)
        self._state = embed(self._state, depth_grid.state.shape, start, UNKNOWN)
        shape = tuple(n // BLOCK for n in depth_grid.state.shape)
        self._read_frame = embed(self._read_frame, shape, start // BLOCK, 0)
        self._whole_frame = embed(self._whole_frame, shape, start // BLOCK, 0)
        self._turn = embed(self._turn, shape, start // BLOCK, 0)
        self._column_version = embed(self._column_version, shape[1:], start[1:] // BLOCK, 0)
        self._corner = corner.copy()
