"""Triangles of the observed surface: marching cubes on the field, block by block, near occupied voxels only."""

from __future__ import annotations

import math

import numpy as np
import trimesh
from jaxtyping import Float, Float32, Int64, UInt8
from scipy.ndimage import binary_dilation
from skimage.measure import marching_cubes

from anm_mj.errors import MapError
from anm_mj.mapping.occupancy import OccupancyGrid
from anm_mj.mapping.surface import SdfQuery
from anm_mj.types import OCCUPIED

_BLOCK_CELLS = 48
"""Lattice cells along the edge of a marching-cubes block."""
_REACH_VOXELS = 0.49
"""A face counts while all its corners lie within this many voxel edges, along each axis, of an occupied voxel."""
_MERGE_DIGITS = 5
"""Decimals of a metre to which vertices of neighbouring blocks are taken for the same."""


def extract_mesh(
    sdf: SdfQuery, occupancy: OccupancyGrid, resolution_m: float
) -> tuple[Float[np.ndarray, "v 3"], Int64[np.ndarray, "f 3"]]:
    """Vertices [m, world] and faces of the SDF's zero level, counter-clockwise as seen from free space.

    Raises:
        MapError: If the resolution is not positive.
    """
    if resolution_m <= 0.0:
        raise MapError(f"The mesh resolution is {resolution_m} m, but it must be positive; 0.05 is usual.")
    near = _lattice_near_occupied(occupancy, resolution_m)
    if near is None:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    inside, corner = near
    all_vertices, all_faces, count = [], [], 0
    for start in np.ndindex(*(-(-(n - 1) // _BLOCK_CELLS) for n in inside.shape)):
        low = np.array(start) * _BLOCK_CELLS
        # One shared layer of lattice points, so that neighbouring blocks meet.
        block = inside[tuple(slice(a, a + _BLOCK_CELLS + 1) for a in low)]
        if min(block.shape) < 2 or not block.any():
            continue
        vertices, faces = _march(sdf, block, low + corner, resolution_m)
        all_vertices.append(vertices)
        all_faces.append(faces + count)
        count += len(vertices)
    if not count:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    vertices, faces = np.concatenate(all_vertices), np.concatenate(all_faces)
    observed = occupancy.near_occupied(vertices, _REACH_VOXELS * occupancy.config.voxel_m)
    return _welded(vertices, faces[observed[faces].all(axis=1)])


def colored_mesh(
    vertices_m: Float[np.ndarray, "v 3"], faces: Int64[np.ndarray, "f 3"], rgb: Float32[np.ndarray, "v 3"]
) -> trimesh.Trimesh:
    """A mesh with vertex colours from values in [0, 1]."""
    alpha = np.full((len(rgb), 1), 255, np.uint8)
    colors: UInt8[np.ndarray, "v 4"] = np.hstack((np.rint(rgb * 255.0).astype(np.uint8), alpha))
    return trimesh.Trimesh(vertices_m, faces, vertex_colors=colors, process=False)


def _lattice_near_occupied(
    occupancy: OccupancyGrid, resolution_m: float
) -> tuple[np.ndarray, Int64[np.ndarray, "3"]] | None:
    """Lattice points [x, y, z] within about a voxel and a cell of an occupied voxel, and the index of the first."""
    state = occupancy.grid.state
    occupied = np.argwhere(state == OCCUPIED)
    if not len(occupied):
        return None
    edge = occupancy.config.voxel_m
    low, high = occupied.min(axis=0), occupied.max(axis=0) + 1
    # A cell is marched only if all its corners are near, so nearness has to reach across a cell.
    reach = math.ceil(resolution_m / edge)
    voxels = np.pad((state[tuple(map(slice, low, high))] == OCCUPIED).transpose(2, 1, 0), reach)
    grown = binary_dilation(voxels, np.ones((3, 3, 3), bool), iterations=reach)
    first_voxel = low[::-1] + occupancy.corner - reach
    first = np.floor(first_voxel * (edge / resolution_m)).astype(np.int64) - 1
    last = np.ceil((first_voxel + grown.shape) * (edge / resolution_m)).astype(np.int64) + 1
    axes = []
    for axis in range(3):
        voxel = np.rint(np.arange(first[axis], last[axis] + 1) * (resolution_m / edge)).astype(np.int64)
        axes.append(voxel - first_voxel[axis])
    clipped = [axis.clip(0, n - 1) for axis, n in zip(axes, grown.shape, strict=True)]
    outside = [(axis < 0) | (axis >= n) for axis, n in zip(axes, grown.shape, strict=True)]
    near = grown[np.ix_(*clipped)]
    for axis, mask in enumerate(outside):
        near[(slice(None),) * axis + (mask,)] = False
    return near, first


def _march(
    sdf: SdfQuery, inside: np.ndarray, corner: Int64[np.ndarray, "3"], resolution_m: float
) -> tuple[Float[np.ndarray, "v 3"], Int64[np.ndarray, "f 3"]]:
    """Marching cubes over the cells of a block whose eight corners are all ``inside``."""
    index = np.argwhere(inside)
    volume = np.ones(inside.shape, np.float32)
    volume[inside] = sdf((index + corner) * resolution_m)
    whole = inside.copy()
    for axis in range(3):
        ahead = np.zeros_like(whole)
        source = [slice(None)] * 3
        target = [slice(None)] * 3
        source[axis], target[axis] = slice(1, None), slice(None, -1)
        ahead[tuple(target)] = whole[tuple(source)]
        whole &= ahead
    # A cell is named by its highest corner in skimage's mask.
    mask = np.zeros_like(whole)
    mask[1:, 1:, 1:] = whole[:-1, :-1, :-1]
    values = volume[mask]
    if not len(values) or not volume.min() < 0.0 < volume.max():
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    try:
        vertices, faces, _, _ = marching_cubes(volume, 0.0, mask=mask, gradient_direction="descent")
    except RuntimeError:
        # skimage's way to say that no masked cell is crossed.
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    return (vertices.astype(float) + corner) * resolution_m, faces.astype(np.int64)


def _welded(
    vertices: Float[np.ndarray, "v 3"], faces: Int64[np.ndarray, "f 3"]
) -> tuple[Float[np.ndarray, "w 3"], Int64[np.ndarray, "g 3"]]:
    """The same triangles with equal vertices merged, unused ones gone and collapsed faces dropped."""
    used, compact = np.unique(faces, return_inverse=True)
    rounded = np.rint(vertices[used] * 10.0**_MERGE_DIGITS).astype(np.int64)
    _, first, merged = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    welded = merged.reshape(-1)[compact.reshape(-1, 3)]
    a, b, c = welded.T
    return vertices[used][first], welded[(a != b) & (b != c) & (c != a)]
