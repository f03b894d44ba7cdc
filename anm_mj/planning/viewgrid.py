"""The occupancy as rays for expected gain see it: pooled to twice the voxel size, padded, kept up where it changed.

A cell is occupied where any of its voxels is, else unknown where half of them are, else free. Cautious carving leaves
an unseen skin on surfaces; what is partly unknown next to occupied is therefore taken for surface that was seen. Where
there is no floor, as beyond an open door to the outside, nothing is looked for: such columns count as seen too. Around
the grid lies a rim of unknown, as wide as rays are long, so that no ray ever leaves the array.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int8

from anm_mj.types import FREE, OCCUPIED, UNKNOWN, VoxelGrid

POOL = 2
"""Voxels along the edge of a cell."""
BLOCK = 32
"""The grid grows by multiples of this many cells, so that it seldom does."""
LOWEST_M = 0.2
"""Nothing is looked for deeper below the floor than this [m]."""
USUAL_SHARE = 0.02
"""Layers of rooms hold at least this share of surface; those above rooms without a ceiling hold next to none."""


class ViewGrid:
    """Tri-state cells ``[layer, row, col]`` with how near each was seen from."""

    def __init__(self, rim_m: float, near_m: float) -> None:
        """Start empty.

        Args:
            rim_m: width of the rim of unknown around what was observed [m].
            near_m: surface seen from farther does not count as seen [m].
        """
        self.rim_m = rim_m
        self.near_m = near_m
        self.cell_m = 0.0
        self.origin_m = np.zeros(3)
        """World x, y, z of the outer corner of cell [0, 0, 0]."""
        shape = (0, 0, 0)
        self.state: Int8[np.ndarray, "layers rows cols"] = np.zeros(shape, np.int8)
        self.seen_range_m: Float32[np.ndarray, "layers rows cols"] = np.zeros(shape, np.float32)
        self.tried_from_m: Float32[np.ndarray, "layers rows cols"] = np.zeros(shape, np.float32)
        """Nearest distance from which a view had each cell in sight and left it unknown; +inf where none had."""
        self.layer_share: Float32[np.ndarray, " layers"] = np.zeros(0, np.float32)
        """How likely it is that what is unknown in a layer holds surface: from how much of the known part does."""
        self.seen_m2 = 0.0
        """How much surface was seen from near enough, each cell counting with one face [m2]: how far exploration is."""
        self.epoch = 0
        """Changes whenever the array does, so that flat indices into it are no longer valid."""

    def update(self, grid: VoxelGrid, low_xy_m: Float[np.ndarray, 2], high_xy_m: Float[np.ndarray, 2]) -> None:
        """Pool the voxels between two corners in the plane anew [m]."""
        self._cover(grid)
        offset = np.rint((grid.origin_m - self.origin_m) / grid.resolution_m).astype(int)[::-1]
        shape = np.array(grid.state.shape)
        low = np.zeros(3, int)
        high = shape.copy()
        for axis, corner in ((1, 1), (2, 0)):
            low[axis] = math.floor((low_xy_m[corner] - grid.origin_m[corner]) / grid.resolution_m)
            high[axis] = math.ceil((high_xy_m[corner] - grid.origin_m[corner]) / grid.resolution_m)
        # Whole cells only: their first voxel has an even index from this grid's own origin.
        # No ray goes below the floor.
        low[0] = math.floor((-LOWEST_M - grid.origin_m[2]) / grid.resolution_m)
        low = np.maximum(low, 0)
        low -= (low + offset) % POOL
        high = np.minimum(high, shape)
        high += (high + offset) % POOL
        if (high <= low).any():
            return
        inside = tuple(slice(max(a, 0), min(b, n)) for a, b, n in zip(low, high, shape, strict=True))
        state, seen = grid.state[inside], grid.seen_range_m[inside]
        pad = [(max(-int(a), 0), max(int(b - n), 0)) for a, b, n in zip(low, high, shape, strict=True)]
        if any(max(p) for p in pad):
            state = np.pad(state, pad, constant_values=UNKNOWN)
            seen = np.pad(seen, pad, constant_values=np.inf)
        to = (low + offset) // POOL
        n = np.array(state.shape) // POOL
        where = tuple(slice(int(a), int(a + b)) for a, b in zip(to, n, strict=True))
        pooled, partly = _pooled(state)
        occupied = np.nonzero(pooled == OCCUPIED)
        nearest = np.full(len(occupied[0]), np.inf, np.float32)
        layer, row, col = (axis * POOL for axis in occupied)
        for corner in range(POOL**3):
            at = (layer + (corner & 1), row + (corner >> 1 & 1), col + (corner >> 2 & 1))
            np.minimum(nearest, seen[at], out=nearest)
        pooled_seen = np.full(pooled.shape, np.inf, np.float32)
        pooled_seen[occupied] = nearest
        skin = partly & next_to(pooled == OCCUPIED)
        pooled[skin], pooled_seen[skin] = OCCUPIED, 0.0
        outside = _without_floor(pooled, math.floor(-self.origin_m[2] / self.cell_m) - int(to[0]))
        pooled[:, outside], pooled_seen[:, outside] = OCCUPIED, 0.0
        face_m2 = self.cell_m**2
        self.seen_m2 += face_m2 * (
            _num_near(pooled_seen, self.near_m) - _num_near(self.seen_range_m[where], self.near_m)
        )
        self.state[where], self.seen_range_m[where] = pooled, pooled_seen
        num_free = np.count_nonzero(pooled == FREE, axis=(1, 2))
        num_occupied = np.bincount(occupied[0], minlength=len(pooled))
        share = num_occupied / np.maximum(num_free + num_occupied, 1)
        self.layer_share[where[0]] = np.where(num_free > 0, np.minimum(share / USUAL_SHARE, 1.0), 1.0)

    def flat_index(self, xyz_m: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
        """Index into the raveled arrays of the cells that hold world points, which must lie inside."""
        x, y, z = np.floor((xyz_m - self.origin_m) / self.cell_m).astype(np.int64).T
        _, rows, cols = self.state.shape
        return (z * rows + y) * cols + x

    def centres(self, flat: Int[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """World x, y, z of cells given by their index into the raveled arrays [m]."""
        layer, row, col = np.unravel_index(flat, self.state.shape)
        return self.origin_m + (np.stack([col, row, layer], axis=1) + 0.5) * self.cell_m

    def _cover(self, grid: VoxelGrid) -> None:
        """Make room for all of ``grid`` and the rim."""
        cell = POOL * grid.resolution_m
        if not self.cell_m:
            self.cell_m = cell
            self.origin_m = grid.origin_m.astype(float)
        low = np.floor((grid.origin_m - self.origin_m) / cell + 1e-6).astype(int)
        high = np.ceil(
            (grid.origin_m + np.array(grid.state.shape[::-1]) * grid.resolution_m - self.origin_m) / cell - 1e-6
        )
        rim = math.ceil(self.rim_m / cell) + 1
        low -= np.array([rim, rim, 0])
        high = high.astype(int) + np.array([rim, rim, 0])
        shape = np.array(self.state.shape)[::-1]
        if shape.all() and (low >= 0).all() and (high <= shape).all():
            return
        room = np.array([BLOCK, BLOCK, 1])
        new_low = np.minimum(np.floor_divide(low, room) * room, 0)
        new_high = -np.floor_divide(-high, room) * room
        if shape.all():
            new_high = np.maximum(new_high, shape)
        else:
            new_low = np.floor_divide(low, room) * room
        new_shape = tuple((new_high - new_low)[::-1].tolist())
        for name, fill, kind in (
            ("state", UNKNOWN, np.int8),
            ("seen_range_m", np.inf, np.float32),
            ("tried_from_m", np.inf, np.float32),
        ):
            new = np.full(new_shape, fill, kind)
            if shape.all():
                new[tuple(slice(-a, -a + n) for a, n in zip(new_low[::-1], shape[::-1], strict=True))] = getattr(
                    self, name
                )
            setattr(self, name, new)
        self.layer_share = np.ones(new_shape[0], np.float32)
        self.origin_m = self.origin_m + new_low * cell
        self.epoch += 1


def _without_floor(state: Int8[np.ndarray, "layers rows cols"], floor: int) -> Bool[np.ndarray, "rows cols"]:
    """Columns that are seen free through the floor's layer and the one below: there the building has ended."""
    if not 1 <= floor < len(state):
        return np.zeros(state.shape[1:], bool)
    return (state[floor] == FREE) & (state[floor - 1] == FREE)


def _num_near(seen_range_m: Float32[np.ndarray, "layers rows cols"], near_m: float) -> int:
    """Cells with surface seen from within a distance; the unseen skin, which is noted as 0, does not count."""
    return int(np.count_nonzero((seen_range_m > 0.0) & (seen_range_m <= near_m)))


def _pooled(
    state: Int8[np.ndarray, "layers rows cols"],
) -> tuple[Int8[np.ndarray, "l r c"], Bool[np.ndarray, "l r c"]]:
    """State of cells of 2 x 2 x 2 voxels, and which of the unknown ones are not unknown throughout."""
    # Of -1, 0 and 1 this leaves 17, 0 and 1, so that one sum holds the unknown in its upper four bits and all that is
    # not free in its lower four.
    total = state.view(np.uint8) & np.uint8(17)
    total = total[0::2] + total[1::2]
    total = total[:, 0::2] + total[:, 1::2]
    total = total[:, :, 0::2] + total[:, :, 1::2]
    num_unknown = total >> 4
    occupied = (total & np.uint8(15)) > num_unknown
    unknown = (num_unknown >= POOL**3 // 2) & ~occupied
    pooled = occupied.astype(np.int8)
    pooled[unknown] = UNKNOWN
    return pooled, unknown & (num_unknown < POOL**3)


def next_to(mask: Bool[np.ndarray, "layers rows cols"]) -> Bool[np.ndarray, "layers rows cols"]:
    """Cells with a face neighbour in the mask."""
    grown = mask.copy()
    grown[1:] |= mask[:-1]
    grown[:-1] |= mask[1:]
    grown[:, 1:] |= mask[:, :-1]
    grown[:, :-1] |= mask[:, 1:]
    grown[:, :, 1:] |= mask[:, :, :-1]
    grown[:, :, :-1] |= mask[:, :, 1:]
    return grown
