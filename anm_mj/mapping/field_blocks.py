"""Which voxels of the occupancy grid the neural field is asked for, what its answers decide, and where they go.

In C++ (``native/field_blocks.h``). Voxels are given by their indices into the raveled grid, blocks by layer, row and
column.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int8, Int64

from anm_mj import _native

_ROOM = 1 << 14
"""Voxels that are found in one call."""

States = Int8[np.ndarray, "layers rows cols"]
Blocks = Int64[np.ndarray, "m 3"]
Voxels = Int64[np.ndarray, " n"]


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


def voxels_to_read(state: States, blocks: Blocks, agreed: States | None = None) -> Voxels:
    """The known voxels of blocks that are occupied, or have a face neighbour in their block that is, block by block.
    ``state`` is of all voxels; those that have the same state in ``agreed`` are left out.
    """
    if agreed is None:
        return _found(_native.voxels_to_read, state, blocks)
    return _found(_native.voxels_in_doubt, state, agreed, blocks)


def _found(find: Callable[..., int], *arrays: np.ndarray) -> Voxels:
    """What a function writes, in a second call where there was no room for it."""
    room = np.empty(_ROOM, np.int64)
    count = find(*arrays, room)
    if count > len(room):
        room = np.empty(count, np.int64)
        find(*arrays, room)
    return room[:count].copy()


def write_blocks(
    state: States, blocks: Blocks, voxels: Voxels, read: Int8[np.ndarray, " n"], out: States
) -> Bool[np.ndarray, " m"]:
    """Take the states of blocks over into ``out``, with those that were ``read`` for the voxels of
    :func:`voxels_to_read`. Returns whether a voxel of each block differs from what it was there.
    """
    moved = np.empty(len(blocks), np.uint8)
    _native.write_blocks(state, blocks, voxels, read, out, moved)
    return moved != 0


def voxel_centres(
    voxels: Voxels, shape: tuple[int, ...], corner: Int64[np.ndarray, "3"], resolution_m: float
) -> Float32[np.ndarray, "n 3"]:
    """World places of the centres of voxels [m]. ``shape`` of the grid is layers, rows, columns; ``corner`` is x, y and
    z of its first voxel, in voxels; ``resolution_m`` is the edge of one [m].
    """
    return _native.voxel_centres(voxels, np.array(shape, np.int64), corner, resolution_m)


def decide_voxels(
    state: States,
    seen_m: Float32[np.ndarray, "layers rows cols"],
    voxels: Voxels,
    sdf_m: Float[np.ndarray, " n"],
    rule: DoubtRule,
) -> Int8[np.ndarray, " n"]:
    """Free or occupied, for voxels that are known by depth. ``state`` is of all voxels by depth, ``seen_m`` the
    smallest depth at which each of them was hit [m], ``sdf_m`` the signed distance at the centres of those to decide
    [m], and ``rule`` says when it outweighs the depth.
    """
    out = np.empty(len(voxels), np.int8)
    distance = np.ascontiguousarray(sdf_m, np.float32)
    _native.decide_voxels(state, seen_m, voxels, distance, np.array(rule, np.float32), out)
    return out
