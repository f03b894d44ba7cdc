"""The zero level of the SDF on a lattice, in cells that touch occupied voxels: its crossings with the edges
(``native/lattice.h``), and its triangles by marching cubes, with the joining of their pieces.
"""

import numpy as np
from jaxtyping import Bool, Float, Int8, Int64
from skimage.measure import marching_cubes

from anm_mj import _native
from anm_mj.mapping.occupancy_kernels import BLOCK
from anm_mj.types import SdfQuery

_MERGE_M = 1e-4
"""Vertices that round to the same multiple of this [m] are one."""
_KEY_BITS = 21
"""Bits per axis of a rounded vertex; they reach 209 m, beyond which far places are told apart no longer."""
Cells = tuple[Bool[np.ndarray, "x y z"], Int64[np.ndarray, "3"]]
"""Which cells of a lattice, and the index of the first one; cell (i, j, k) spans ``[i, i + 1]`` spacings along x."""


def touched_cells(
    state: Int8[np.ndarray, "layers rows cols"],
    corner: Int64[np.ndarray, "3"],
    blocks: Int64[np.ndarray, "n 3"],
    cells_per_voxel: float,
) -> Cells:
    """The lattice cells that touch an occupied voxel of some blocks, in the smallest box about them. ``state`` is of
    all voxels, ``corner`` x, y and z of the first one, in voxels, ``blocks`` have x, y and z in blocks; a voxel's edge
    is ``cells_per_voxel`` spacings of the lattice.
    """
    places = np.ascontiguousarray((blocks - corner // BLOCK)[:, ::-1])
    voxel = blocks[:, :, None] * BLOCK + np.arange(BLOCK)
    low = np.floor((voxel - 0.5) * cells_per_voxel + 1e-6).astype(np.int64)
    high = np.floor((voxel + 0.5) * cells_per_voxel - 1e-6).astype(np.int64)
    # First and last cell that each voxel of a block touches along each axis.
    found = _native.touched_cells(state, places, low, high)
    if found is None:
        return np.zeros((0, 0, 0), bool), np.zeros(3, np.int64)
    cells, first = found
    return cells.view(bool), np.array(first, np.int64)


def crossings(
    sdf: SdfQuery, cells: Bool[np.ndarray, "x y z"], corner: Int64[np.ndarray, "3"], spacing_m: float
) -> Float[np.ndarray, "n 3"]:
    """Zero-crossings on the edges of lattice cells, by linear interpolation, each once. Returns world points [m].

    ``cells`` says which to look at, by x, y, z: cell [0, 0, 0] has the index ``corner``, and cell (i, j, k) spans ``[i,
    i + 1] * spacing_m`` along x, and so on.
    """
    corners = np.zeros([n + 1 for n in cells.shape], np.uint8)
    points_m = _native.lattice_corners(cells.view(np.uint8), corner, spacing_m, corners)
    return _native.lattice_crossings(corners, np.ascontiguousarray(sdf(points_m), np.float32), corner, spacing_m)


def active_cells(
    occupied: Cells, first: Int64[np.ndarray, "3"], end: Int64[np.ndarray, "3"], ratio: float, reach: float
) -> Bool[np.ndarray, "cx cy cz"]:
    """Which cells of a lattice, from index ``first`` up to, not including, ``end``, have an occupied voxel within
    ``reach`` voxel edges of them along every axis.

    The centre of voxel (i, j, k) lies that many voxel edges from the index of the first one, which ``occupied`` says
    beside the voxels; cell (i, j, k) spans ``[i, i + 1] * ratio`` voxel edges along x, and so on.
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
    """Vertices [m, world] and faces of the zero level in the chosen cells, of which [0, 0, 0] has the index ``first``
    in the lattice; their edge is ``spacing_m``.
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
