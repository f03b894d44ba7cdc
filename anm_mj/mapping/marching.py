"""Marching cubes over chosen cells of a lattice, and the joining of its pieces."""

import numpy as np
from jaxtyping import Bool, Float, Int64
from skimage.measure import marching_cubes

from anm_mj.mapping.lattice import Cells
from anm_mj.types import SdfQuery

_MERGE_M = 1e-4
"""Vertices that round to the same multiple of this [m] are one."""
_KEY_BITS = 21
"""Bits per axis of a rounded vertex; they reach 209 m, beyond which far places are told apart no longer."""


def active_cells(
    occupied: Cells, first: Int64[np.ndarray, "3"], end: Int64[np.ndarray, "3"], ratio: float, reach: float
) -> Bool[np.ndarray, "cx cy cz"]:
    """Which cells of a lattice have an occupied voxel within ``reach`` of them along every axis.

    Args:
        occupied: Which voxels, and the index of the first one; the centre of voxel (i, j, k) lies that many voxel edges
            from it.
        first: Index of the first cell; cell (i, j, k) spans ``[i, i + 1] * ratio`` voxel edges along x, and so on.
        end: Index after the last cell.
        ratio: Edge of a cell in voxel edges.
        reach: Distance in voxel edges.
    """
    cells, corner = occupied
    for axis in range(3):
        index = np.arange(first[axis], end[axis])
        low = np.rint(index * ratio - reach).astype(np.int64) - corner[axis]
        high = np.rint((index + 1) * ratio + reach).astype(np.int64) - corner[axis]
        size = cells.shape[axis]
        out = np.zeros((*cells.shape[:axis], len(index), *cells.shape[axis + 1 :]), bool)
        at = (slice(None),) * axis
        for offset in range(int((high - low).max(initial=-1)) + 1):
            voxel = np.minimum(low + offset, high)
            inside = (voxel >= 0) & (voxel < size)
            out[(*at, inside)] |= cells[(*at, voxel[inside])]
        cells = out
    return cells


def march(
    sdf: SdfQuery, cells: Bool[np.ndarray, "x y z"], first: Int64[np.ndarray, "3"], spacing_m: float
) -> tuple[Float[np.ndarray, "v 3"], Int64[np.ndarray, "f 3"]]:
    """Vertices [m, world] and faces of the zero level in the chosen cells.

    Args:
        sdf: Signed distance at world points, in any unit.
        cells: Which cells to look at.
        first: Index of cell [0, 0, 0] in the lattice.
        spacing_m: Edge of a cell [m].
    """
    nothing = np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    if not cells.any():
        return nothing
    needed = corners_of(cells)
    values = sdf((np.argwhere(needed) + first) * spacing_m)
    if not values.min() < 0.0 < values.max():
        return nothing
    volume = np.ones(needed.shape, np.float32)
    volume[needed] = values
    # A cell is named by its highest corner in skimage's mask.
    mask = np.zeros(needed.shape, bool)
    mask[1:, 1:, 1:] = cells
    try:
        vertices, faces, _, _ = marching_cubes(volume, 0.0, mask=mask, gradient_direction="descent")
    except RuntimeError:
        # skimage's way to say that no masked cell is crossed.
        return nothing
    return (vertices.astype(float) + first) * spacing_m, faces.astype(np.int64)


def remove_unreferenced(
    vertices: Float[np.ndarray, "v 3"], faces: Int64[np.ndarray, "f 3"]
) -> tuple[Float[np.ndarray, "w 3"], Int64[np.ndarray, "f 3"]]:
    """The same triangles without the vertices that none has."""
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    return vertices[used], (np.cumsum(used) - 1)[faces]


def merge_vertices(
    vertices: Float[np.ndarray, "v 3"], faces: Int64[np.ndarray, "f 3"]
) -> tuple[Int64[np.ndarray, " w"], Int64[np.ndarray, "g 3"]]:
    """Equal vertices merged and collapsed faces dropped. Returns which vertices stay, and the faces over those, which
    were changed in place.
    """
    # Axis by axis, as a mesh and its copies may be most of the memory that a run takes.
    key = np.zeros(len(vertices), np.int64)
    for axis in vertices.T:
        place = np.rint(axis / _MERGE_M).astype(np.int64)
        place -= place.min(initial=np.iinfo(np.int64).max)
        place &= (1 << _KEY_BITS) - 1
        key <<= _KEY_BITS
        key |= place
    _, kept, merged = np.unique(key, return_index=True, return_inverse=True)
    del key
    for corner in faces.T:
        corner[...] = merged[corner]
    a, b, c = faces.T
    return kept, faces[(a != b) & (b != c) & (c != a)]


def corners_of(cells: Bool[np.ndarray, "x y z"]) -> Bool[np.ndarray, "x1 y1 z1"]:
    """Corners of lattice cells, on a grid larger by one along each axis."""
    corners = np.zeros([n + 1 for n in cells.shape], bool)
    for offset in np.ndindex(2, 2, 2):
        corners[tuple(slice(a, a + n) for a, n in zip(offset, cells.shape, strict=True))] |= cells
    return corners
