"""Zero-crossings of the SDF on the edges of a lattice, in cells that touch occupied voxels (``native/lattice.h``)."""

import numpy as np
from jaxtyping import Bool, Float, Int8, Int64

from anm_mj import _native
from anm_mj.mapping.occupancy_kernels import BLOCK
from anm_mj.types import SdfQuery

Cells = tuple[Bool[np.ndarray, "x y z"], Int64[np.ndarray, "3"]]
"""Which cells of a lattice, and the index of the first one; cell (i, j, k) spans ``[i, i + 1]`` spacings along x."""


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

    Args:
        sdf: Signed distance at world points, in any unit.
        cells: Which lattice cells to look at, by x, y, z.
        corner: Index of cell [0, 0, 0]; cell (i, j, k) spans ``[i, i + 1] * spacing_m`` along x, and so on.
        spacing_m: Spacing of the lattice [m].
    """
    corners = np.zeros([n + 1 for n in cells.shape], np.uint8)
    points_m = _native.lattice_corners(cells.view(np.uint8), corner, spacing_m, corners)
    return _native.lattice_crossings(corners, np.ascontiguousarray(sdf(points_m), np.float32), corner, spacing_m)
