"""Which voxels of the occupancy grid the neural field is asked for, and where its answers go, block by block.

In NumPy, and in C++ (``native/field_blocks.h``), which gives the same in a tenth of the time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Bool, Int8, Int64, Shaped

from anm_mj.mapping.occupancy_fusion import BLOCK
from anm_mj.types import OCCUPIED, UNKNOWN
from anm_mj.utils.arrays import dilate_mask
from anm_mj.utils.native_functions import native_function


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


class NativeBlocks:
    """The same in C++."""

    def __init__(
        self,
        voxels_to_read: Callable[..., int],
        write_blocks: Callable[..., Any],
        voxels_in_doubt: Callable[..., int] | None,
    ) -> None:
        """Wrap the functions of the engine's module; an older engine lacks the last one."""
        self._voxels_to_read, self._write_blocks = voxels_to_read, write_blocks
        self._voxels_in_doubt = voxels_in_doubt
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


def field_blocks() -> NumpyBlocks | NativeBlocks:
    """The native kernels where they were built, else NumPy's."""
    functions = native_function("voxels_to_read"), native_function("write_blocks")
    if functions[0] is None or functions[1] is None:
        return NumpyBlocks()
    return NativeBlocks(functions[0], functions[1], native_function("voxels_in_doubt"))


def blocks_of(voxels: Shaped[np.ndarray, "layers rows cols"]) -> Shaped[np.ndarray, "bl br bc b b b"]:
    """A view of voxels by block: ``[block layer, block row, block col, layer, row, col]``."""
    layers, rows, cols = (n // BLOCK for n in voxels.shape)
    return voxels.reshape(layers, BLOCK, rows, BLOCK, cols, BLOCK).transpose(0, 2, 4, 1, 3, 5)
