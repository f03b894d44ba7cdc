"""Zero-crossings of the SDF on the edges of a lattice, in the cells that touch occupied voxels.

In C++ (``native/lattice.h``) where the engine was built, else in NumPy, which gives the same.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int8, Int64

from anm_mj.mapping.field_blocks import blocks_of
from anm_mj.mapping.occupancy_kernels import BLOCK
from anm_mj.types import OCCUPIED, SdfQuery
from anm_mj.utils.native_functions import native_function

Cells = tuple[Bool[np.ndarray, "x y z"], Int64[np.ndarray, "3"]]
"""Which cells of a lattice, and the index of the first one; cell (i, j, k) spans ``[i, i + 1]`` spacings along x."""
Spans = tuple[Int64[np.ndarray, "n 3 voxels"], Int64[np.ndarray, "n 3 voxels"]]
"""First and last cell that each voxel of a block touches along x, y and z."""


def touched_cells(
    state: Int8[np.ndarray, "layers rows cols"],
    corner: Int64[np.ndarray, "3"],
    blocks: Int64[np.ndarray, "n 3"],
    cells_per_voxel: float,
) -> Cells:
    """The lattice cells that touch an occupied voxel of some blocks, in the smallest box about them.

    Args:
        state: of all voxels.
        corner: x, y and z of the grid's first voxel, in voxels.
        blocks: x, y and z of each block, in blocks.
        cells_per_voxel: edge of a voxel in spacings of the lattice.
    """
    places = np.ascontiguousarray((blocks - corner // BLOCK)[:, ::-1])
    voxel = blocks[:, :, None] * BLOCK + np.arange(BLOCK)
    low = np.floor((voxel - 0.5) * cells_per_voxel + 1e-6).astype(np.int64)
    high = np.floor((voxel + 0.5) * cells_per_voxel - 1e-6).astype(np.int64)
    native = native_function("touched_cells")
    if native is None:
        return numpy_touched_cells(state, places, (low, high))
    found = native(state, places, low, high)
    if found is None:
        return np.zeros((0, 0, 0), bool), np.zeros(3, np.int64)
    cells, first = found
    return cells.view(bool), np.array(first, np.int64)


def numpy_touched_cells(
    state: Int8[np.ndarray, "layers rows cols"], places: Int64[np.ndarray, "n 3"], spans: Spans
) -> Cells:
    """The reference of :func:`touched_cells`, for blocks by layer, row and column."""
    occupied = blocks_of(state)[tuple(places.T)] == OCCUPIED
    low, high = spans
    corner = low[:, :, 0]
    cell = corner[:, :, None, None] + np.arange((high[:, :, -1] - corner).max(initial=0) + 1)
    touched = ((low[..., None] <= cell) & (cell <= high[..., None])).astype(np.float32)
    # As counts, axis by axis: which voxels touch a cell along one axis does not depend on the others.
    count = occupied.astype(np.float32) @ touched[:, 0, None]
    count = touched[:, 1, None].swapaxes(-1, -2) @ count
    count = np.einsum("bzi,bzyx->biyx", touched[:, 2], count, optimize=True)
    block, z, y, x = np.nonzero(count > 0.0)
    if not len(block):
        return np.zeros((0, 0, 0), bool), np.zeros(3, np.int64)
    cell = corner[block] + np.stack((x, y, z), axis=1)
    first = cell.min(axis=0)
    cells = np.zeros(cell.max(axis=0) - first + 1, bool)
    cells[tuple((cell - first).T)] = True
    return cells, first


def crossings(
    sdf: SdfQuery, cells: Bool[np.ndarray, "x y z"], corner: Int64[np.ndarray, "3"], spacing_m: float
) -> Float[np.ndarray, "n 3"]:
    """Zero-crossings on the edges of lattice cells, by linear interpolation, each once.

    Args:
        sdf: Signed distance at world points, in any unit.
        cells: Which lattice cells to look at, by x, y, z.
        corner: Index of cell [0, 0, 0]; cell (i, j, k) spans ``[i, i + 1] * spacing_m`` along x, and so on.
        spacing_m: Spacing of the lattice [m].

    Returns:
        World points [m].
    """
    native = native_function("lattice_corners"), native_function("lattice_crossings")
    if native[0] is None or native[1] is None:
        return numpy_crossings(sdf, cells, corner, spacing_m)
    corners = np.zeros([n + 1 for n in cells.shape], np.uint8)
    points_m = native[0](cells.view(np.uint8), corner, spacing_m, corners)
    return native[1](corners, np.ascontiguousarray(sdf(points_m), np.float32), corner, spacing_m)


def numpy_crossings(
    sdf: SdfQuery, cells: Bool[np.ndarray, "x y z"], corner: Int64[np.ndarray, "3"], spacing_m: float
) -> Float[np.ndarray, "n 3"]:
    """The reference of :func:`crossings`."""
    needed = corners_of(cells)
    values = np.zeros(needed.shape, np.float32)
    values[needed] = sdf(((np.argwhere(needed) + corner) * spacing_m).astype(np.float32))
    positive = values > 0.0
    points = [np.zeros((0, 3))]
    for axis in range(3):
        below, above = (tuple(s if a == axis else slice(None) for a in range(3)) for s in (slice(-1), slice(1, None)))
        cross = needed[below] & needed[above] & (positive[below] != positive[above])
        low, high = values[below][cross], values[above][cross]
        point = (np.argwhere(cross) + corner).astype(float)
        point[:, axis] += low / (low - high)
        points.append(point * spacing_m)
    return np.concatenate(points)


def corners_of(cells: Bool[np.ndarray, "x y z"]) -> Bool[np.ndarray, "x1 y1 z1"]:
    """Corners of lattice cells, on a grid larger by one along each axis."""
    corners = np.zeros([n + 1 for n in cells.shape], bool)
    for offset in np.ndindex(2, 2, 2):
        corners[tuple(slice(a, a + n) for a, n in zip(offset, cells.shape, strict=True))] |= cells
    return corners
