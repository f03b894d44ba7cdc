"""Which voxels of the occupancy grid the neural field is asked for, what its answers decide, and where they go.

In NumPy, and in C++ (``native/field_blocks.h``), which gives the same in a tenth of the time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int8, Int64, Shaped

from anm_mj.mapping.occupancy_kernels import BLOCK
from anm_mj.types import FREE, OCCUPIED, UNKNOWN
from anm_mj.utils.arrays import dilate_mask
from anm_mj.utils.native_functions import native_function


class DoubtRule(NamedTuple):
    """When the field outweighs what depth says of a voxel."""

    hit_m: float
    """A hit stands where the signed distance is at most this [m]."""
    half_m: float
    """Half the edge of a voxel [m]."""
    noise_per_m: float
    """Noise explains a hit that lies off its voxel by this times the square of the depth that it was seen at [1/m]."""
    passed_m: float
    """A ray frees voxels whose centres lie this far in front of what it measured [m]."""
    ray_reach_m: float
    """Noise explains rays that went so far into the solid [m]."""


class NumpyBlocks:
    """The reference."""

    def to_read(
        self,
        state: Int8[np.ndarray, "layers rows cols"],
        blocks: Int64[np.ndarray, "m 3"],
        agreed: Int8[np.ndarray, "layers rows cols"] | None = None,
    ) -> Int64[np.ndarray, " n"]:
        """The known voxels of blocks that are occupied, or have a face neighbour in their block that is.

        Args:
            state: of all voxels.
            blocks: layer, row and column of each block.
            agreed: leaves out voxels that have the same state here.

        Returns:
            Indices into the raveled grid, block by block.
        """
        known = blocks_of(state)[tuple(blocks.T)]
        beside = dilate_mask(known == OCCUPIED, first_axis=1) & (known != UNKNOWN)
        block, *within = np.nonzero(beside)
        layer, row, col = blocks.T[:, block] * BLOCK + np.stack(within)
        _, rows, cols = state.shape
        voxels = (layer * rows + row) * cols + col
        if agreed is None:
            return voxels
        return voxels[state.reshape(-1)[voxels] != agreed.reshape(-1)[voxels]]

    def write(
        self,
        state: Int8[np.ndarray, "layers rows cols"],
        blocks: Int64[np.ndarray, "m 3"],
        voxels: Int64[np.ndarray, " n"],
        read: Int8[np.ndarray, " n"],
        out: Int8[np.ndarray, "layers rows cols"],
    ) -> Bool[np.ndarray, " m"]:
        """Take over the states of blocks, and other ones for some voxels.

        Args:
            state: of all voxels.
            blocks: layer, row and column of each block.
            voxels: as :meth:`to_read` gave them.
            read: their states.
            out: what is written to.

        Returns:
            Whether a voxel of each block differs from what it was.
        """
        here, view = tuple(blocks.T), blocks_of(out)
        before = view[here]
        view[here] = blocks_of(state)[here]
        out.reshape(-1)[voxels] = read
        return (view[here] != before).any(axis=(1, 2, 3))

    def centres(
        self,
        voxels: Int64[np.ndarray, " n"],
        shape: tuple[int, ...],
        corner: Int64[np.ndarray, "3"],
        resolution_m: float,
    ) -> Float32[np.ndarray, "n 3"]:
        """World places of the centres of voxels [m].

        Args:
            voxels: indices into the raveled grid.
            shape: of the grid: layers, rows, columns.
            corner: x, y and z of the grid's first voxel, in voxels.
            resolution_m: edge of a voxel [m].
        """
        points_m = np.empty((len(voxels), 3), np.float32)
        for axis, index in enumerate(np.unravel_index(voxels, shape)[::-1]):
            points_m[:, axis] = (index + corner[axis]) * resolution_m
        return points_m

    def decide(
        self,
        state: Int8[np.ndarray, "layers rows cols"],
        seen_m: Float32[np.ndarray, "layers rows cols"],
        voxels: Int64[np.ndarray, " n"],
        sdf_m: Float[np.ndarray, " n"],
        rule: DoubtRule,
    ) -> Int8[np.ndarray, " n"]:
        """Free or occupied, for voxels that are known by depth.

        Args:
            state: of all voxels, by depth.
            seen_m: smallest depth at which each voxel was hit [m].
            voxels: indices into the raveled grid.
            sdf_m: signed distance at their centres [m].
            rule: when it outweighs the depth.
        """
        sdf_m = sdf_m.astype(np.float32)
        seen, hit = seen_m.reshape(-1)[voxels], state.reshape(-1)[voxels] == OCCUPIED
        hit_m, half_m, noise_per_m, passed_m, ray_reach_m = (np.float32(number) for number in rule)
        # Only a hit has been seen from somewhere; a ray may have passed a voxel from as far away as it carves.
        explained_m = noise_per_m * np.where(hit, seen, np.float32(1.0)) ** 2
        passed = (sdf_m <= 0.0) & (passed_m - sdf_m <= ray_reach_m)
        solid = np.where(hit, (sdf_m <= hit_m) | (sdf_m - half_m > explained_m), passed)
        return np.where(solid, np.int8(OCCUPIED), np.int8(FREE))


class NativeBlocks(NumpyBlocks):
    """The same in C++."""

    def __init__(
        self,
        voxels_to_read: Callable[..., int],
        write_blocks: Callable[..., Any],
        voxels_in_doubt: Callable[..., int] | None,
        voxel_centres: Callable[..., Any] | None = None,
        decide_voxels: Callable[..., Any] | None = None,
    ) -> None:
        """Wrap the functions of the engine's module; older engines lack some."""
        self._voxels_to_read, self._write_blocks = voxels_to_read, write_blocks
        self._voxels_in_doubt = voxels_in_doubt
        self._voxel_centres, self._decide_voxels = voxel_centres, decide_voxels
        self._room = np.empty(1 << 14, np.int64)

    def to_read(
        self,
        state: Int8[np.ndarray, "layers rows cols"],
        blocks: Int64[np.ndarray, "m 3"],
        agreed: Int8[np.ndarray, "layers rows cols"] | None = None,
    ) -> Int64[np.ndarray, " n"]:
        """Voxels to ask the field for; see the reference."""
        if agreed is None or self._voxels_in_doubt is None:
            voxels = self._all(self._voxels_to_read, state, blocks)
            return voxels if agreed is None else voxels[state.reshape(-1)[voxels] != agreed.reshape(-1)[voxels]]
        return self._all(self._voxels_in_doubt, state, agreed, blocks)

    def _all(self, find: Callable[..., int], *arrays: np.ndarray) -> Int64[np.ndarray, " n"]:
        """What a function writes, in a second call where there was no room for it."""
        count = find(*arrays, self._room)
        if count > len(self._room):
            self._room = np.empty(2 * count, np.int64)
            find(*arrays, self._room)
        return self._room[:count].copy()

    def write(
        self,
        state: Int8[np.ndarray, "layers rows cols"],
        blocks: Int64[np.ndarray, "m 3"],
        voxels: Int64[np.ndarray, " n"],
        read: Int8[np.ndarray, " n"],
        out: Int8[np.ndarray, "layers rows cols"],
    ) -> Bool[np.ndarray, " m"]:
        """Take over the states of blocks; see the reference."""
        moved = np.empty(len(blocks), np.uint8)
        self._write_blocks(state, blocks, voxels, read, out, moved)
        return moved != 0

    def centres(
        self,
        voxels: Int64[np.ndarray, " n"],
        shape: tuple[int, ...],
        corner: Int64[np.ndarray, "3"],
        resolution_m: float,
    ) -> Float32[np.ndarray, "n 3"]:
        """World places of voxels [m]; see the reference."""
        if self._voxel_centres is None:
            return super().centres(voxels, shape, corner, resolution_m)
        return self._voxel_centres(voxels, np.array(shape, np.int64), corner, resolution_m)

    def decide(
        self,
        state: Int8[np.ndarray, "layers rows cols"],
        seen_m: Float32[np.ndarray, "layers rows cols"],
        voxels: Int64[np.ndarray, " n"],
        sdf_m: Float[np.ndarray, " n"],
        rule: DoubtRule,
    ) -> Int8[np.ndarray, " n"]:
        """Free or occupied; see the reference."""
        if self._decide_voxels is None:
            return super().decide(state, seen_m, voxels, sdf_m, rule)
        out = np.empty(len(voxels), np.int8)
        distance = np.ascontiguousarray(sdf_m, np.float32)
        self._decide_voxels(state, seen_m, voxels, distance, np.array(rule, np.float32), out)
        return out


def field_blocks() -> NumpyBlocks:
    """The native kernels where they were built, else NumPy's."""
    functions = native_function("voxels_to_read"), native_function("write_blocks")
    if functions[0] is None or functions[1] is None:
        return NumpyBlocks()
    later = (native_function(name) for name in ("voxels_in_doubt", "voxel_centres", "decide_voxels"))
    return NativeBlocks(functions[0], functions[1], *later)


def blocks_of(voxels: Shaped[np.ndarray, "layers rows cols"]) -> Shaped[np.ndarray, "bl br bc b b b"]:
    """A view of voxels by block: ``[block layer, block row, block col, layer, row, col]``."""
    layers, rows, cols = (n // BLOCK for n in voxels.shape)
    return voxels.reshape(layers, BLOCK, rows, BLOCK, cols, BLOCK).transpose(0, 2, 4, 1, 3, 5)
