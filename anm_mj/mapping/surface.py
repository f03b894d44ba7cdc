"""Points on the zero-crossing of the SDF, where something was observed; kept per block between calls."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int64

from anm_mj.mapping.occupancy import BLOCK, OccupancyGrid
from anm_mj.types import OCCUPIED

_NORMAL_STEP_M = 0.02
"""Half the distance that normals are differenced over [m]: the noise of a 1 cm grid is averaged, corners are kept."""
_REACH_VOXELS = 0.49
"""A crossing counts within this many voxel edges, along each axis, of an occupied voxel."""
_TETRAHEDRON = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])

SdfQuery = Callable[[Float[np.ndarray, "n 3"]], Float32[np.ndarray, " n"]]
"""World points [m] to signed distance."""


@dataclass(frozen=True)
class _Patch:
    """Zero-crossings in one block, as of the time it was last seen."""

    stamp: int
    xyz_m: Float32[np.ndarray, "n 3"]
    normal: Float32[np.ndarray, "n 3"]


class SurfaceExtractor:
    """Finds zero-crossings on the edges of a lattice and remembers them for blocks that no new frame has touched.

    Only lattice cells that touch an occupied voxel are looked at: elsewhere the field's sign is its own invention.
    """

    def __init__(self, occupancy: OccupancyGrid, spacing_m: float) -> None:
        self._occupancy = occupancy
        self._spacing_m = spacing_m
        self._patches: dict[tuple[int, int, int], _Patch] = {}

    def extract(
        self, sdf: SdfQuery, centre_xy_m: Float[np.ndarray, "2"], radius_m: float
    ) -> tuple[Float32[np.ndarray, "n 3"], Float32[np.ndarray, "n 3"]]:
        """Points and unit normals (into free space) within ``radius_m`` of a place in the plane, in the world [m].

        A block's points are those at the time of the last frame that had a hit in it.
        """
        keys, stamps = self._blocks_about(centre_xy_m, radius_m)
        stale = [
            (key, stamp)
            for key, stamp in zip(keys, stamps, strict=True)
            if key not in self._patches or self._patches[key].stamp != stamp
        ]
        self._refresh(sdf, stale)
        patches = [self._patches[key] for key in keys]
        points = np.concatenate([np.zeros((0, 3), np.float32), *(p.xyz_m for p in patches)])
        normals = np.concatenate([np.zeros((0, 3), np.float32), *(p.normal for p in patches)])
        inside = np.hypot(*(points[:, :2] - centre_xy_m).T) <= radius_m
        return points[inside], normals[inside]

    def _blocks_about(
        self, centre_xy_m: Float[np.ndarray, "2"], radius_m: float
    ) -> tuple[list[tuple[int, int, int]], list[int]]:
        """Blocks with hits that reach into the disc, as x, y, z indices, and the frames that last hit them."""
        stamp = self._occupancy.block_stamp
        layer, row, col = np.nonzero(stamp)
        block = np.stack((col, row, layer), axis=1) + self._occupancy.corner // BLOCK
        edge_m = BLOCK * self._occupancy.config.voxel_m
        centre = (block[:, :2] + 0.5) * edge_m
        near = np.hypot(*(centre - centre_xy_m).T) <= radius_m + edge_m
        keys = [(int(x), int(y), int(z)) for x, y, z in block[near]]
        return keys, stamp[layer, row, col][near].tolist()

    def _refresh(self, sdf: SdfQuery, stale: list[tuple[tuple[int, int, int], int]]) -> None:
        """Look for crossings in the given blocks, all in one query."""
        if not stale:
            return
        blocks = np.array([key for key, _ in stale])
        cells = self._active_cells(blocks)
        points, normals = crossings(sdf, cells, self._spacing_m)
        edge = self._occupancy.config.voxel_m
        keep = self._occupancy.near_occupied(points, _REACH_VOXELS * edge)
        points, normals = points[keep], normals[keep]
        # A crossing belongs to the block of its nearest voxel, so that each is stored once.
        owner = np.floor_divide(np.rint(points / edge).astype(np.int64), BLOCK)
        for key, stamp in stale:
            mine = (owner == key).all(axis=1)
            self._patches[key] = _Patch(stamp, points[mine], normals[mine])

    def _active_cells(self, blocks: Int64[np.ndarray, "n 3"]) -> Int64[np.ndarray, "m 3"]:
        """Lattice cells (x, y, z) that touch an occupied voxel of the given blocks, each once."""
        edge = self._occupancy.config.voxel_m
        grid = self._occupancy.grid.state
        voxels = []
        for block in blocks:
            x, y, z = block * BLOCK - self._occupancy.corner
            part = grid[z : z + BLOCK, y : y + BLOCK, x : x + BLOCK]
            voxels.append(np.argwhere(part == OCCUPIED)[:, ::-1] + block * BLOCK)
        occupied = np.concatenate(voxels)
        low = np.floor((occupied - 0.5) * (edge / self._spacing_m) + 1e-6).astype(np.int64)
        high = np.floor((occupied + 0.5) * (edge / self._spacing_m) - 1e-6).astype(np.int64)
        span = int((high - low).max(initial=0)) + 1
        offsets = np.indices((span, span, span)).reshape(3, -1).T
        cells = np.minimum(low[:, None] + offsets, high[:, None]).reshape(-1, 3)
        return np.unique(cells, axis=0)


def crossings(
    sdf: SdfQuery, cells: Int64[np.ndarray, "m 3"], spacing_m: float
) -> tuple[Float32[np.ndarray, "n 3"], Float32[np.ndarray, "n 3"]]:
    """Zero-crossings on the edges of lattice cells, by linear interpolation, and their normals by differences.

    Args:
        sdf: Signed distance at world points, in any unit.
        cells: Lattice cells; cell (i, j, k) spans ``[i, i + 1] * spacing_m`` along x, and so on.
        spacing_m: Spacing of the lattice [m].

    Returns:
        World points [m] and unit normals that point to where the SDF grows.
    """
    if not len(cells):
        return np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32)
    base = cells.min(axis=0)
    shape = cells.max(axis=0) - base + 2
    index = np.full(shape, -1, np.int64)
    needed = np.zeros(shape, bool)
    for offset in np.indices((2, 2, 2)).reshape(3, -1).T:
        needed[tuple((cells - base + offset).T)] = True
    vertices = np.argwhere(needed)
    index[needed] = np.arange(len(vertices))
    value = sdf((vertices + base) * spacing_m)
    points = []
    for axis in range(3):
        neighbour = vertices.copy()
        neighbour[:, axis] += 1
        exists = neighbour[:, axis] < shape[axis]
        other = np.full(len(vertices), -1)
        other[exists] = index[tuple(neighbour[exists].T)]
        first = np.flatnonzero(other >= 0)
        second = other[first]
        cross = (value[first] > 0.0) != (value[second] > 0.0)
        first, second = first[cross], second[cross]
        share = value[first] / (value[first] - value[second])
        point = (vertices[first] + base).astype(float)
        point[:, axis] += share
        points.append(point * spacing_m)
    xyz = np.concatenate(points)
    return xyz.astype(np.float32), gradient_directions(sdf, xyz)


def gradient_directions(sdf: SdfQuery, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n 3"]:
    """Unit vectors along the SDF's gradient, from four differences on a tetrahedron about each point."""
    arms = _TETRAHEDRON * (_NORMAL_STEP_M / np.sqrt(3.0))
    values = sdf((points_m[:, None] + arms).reshape(-1, 3)).reshape(-1, 4)
    gradient = values @ _TETRAHEDRON.astype(np.float32)
    length = np.linalg.norm(gradient, axis=1, keepdims=True)
    flat = length[:, 0] < 1e-9
    gradient[flat] = (0.0, 0.0, 1.0)
    return (gradient / np.where(flat[:, None], 1.0, length)).astype(np.float32)
