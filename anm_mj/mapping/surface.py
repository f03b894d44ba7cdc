"""Points on the zero-crossing of the SDF, where something was observed; kept per block between calls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int64

from anm_mj.mapping.field_blocks import blocks_of
from anm_mj.mapping.occupancy import OccupancyGrid
from anm_mj.mapping.occupancy_fusion import BLOCK
from anm_mj.types import OCCUPIED, SdfQuery

_NORMAL_STEP_M = 0.02
"""Half the distance that normals are differenced over [m]: the noise of a 1 cm grid is averaged, corners are kept."""
REACH_VOXELS = 0.49
"""A crossing or a corner of a face counts within this many voxel edges, along each axis, of an occupied voxel."""
_TETRAHEDRON = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])


@dataclass(frozen=True)
class _Patch:
    """Zero-crossings in one block, as of the time it was last seen."""

    stamp: int
    xyz_m: Float32[np.ndarray, "n 3"]
    normal: Float32[np.ndarray, "n 3"] | None
    """None as long as nobody asked for normals."""


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
        patches = self._up_to_date(sdf, centre_xy_m, radius_m, with_normals=True)
        normals = [p.normal for p in patches if p.normal is not None]
        points, inside = _within(patches, centre_xy_m, radius_m)
        return points[inside], np.concatenate([np.zeros((0, 3), np.float32), *normals])[inside]

    def places(self, sdf: SdfQuery, centre_xy_m: Float[np.ndarray, "2"], radius_m: float) -> Float32[np.ndarray, "n 3"]:
        """The points alone: normals cost four queries each."""
        points, inside = _within(
            self._up_to_date(sdf, centre_xy_m, radius_m, with_normals=False), centre_xy_m, radius_m
        )
        return points[inside]

    def _up_to_date(
        self, sdf: SdfQuery, centre_xy_m: Float[np.ndarray, "2"], radius_m: float, *, with_normals: bool
    ) -> list[_Patch]:
        """The patches that reach into the disc, after those that a frame has touched were made anew."""
        stamps = self._blocks_about(centre_xy_m, radius_m)
        stale = {
            key: stamp
            for key, stamp in stamps.items()
            if (patch := self._patches.get(key)) is None
            or patch.stamp != stamp
            or (with_normals and patch.normal is None)
        }
        self._refresh(sdf, stale, with_normals=with_normals)
        return [self._patches[key] for key in stamps]

    def _blocks_about(self, centre_xy_m: Float[np.ndarray, "2"], radius_m: float) -> dict[tuple[int, int, int], int]:
        """Blocks with hits that reach into the disc, by x, y, z indices, and the frames that last hit them."""
        stamp = self._occupancy.block_stamp
        layer, row, col = np.nonzero(stamp)
        block = np.stack((col, row, layer), axis=1) + self._occupancy.corner // BLOCK
        edge_m = BLOCK * self._occupancy.config.voxel_m
        centre = (block[:, :2] + 0.5) * edge_m
        near = np.hypot(*(centre - centre_xy_m).T) <= radius_m + edge_m
        keys = [(int(x), int(y), int(z)) for x, y, z in block[near]]
        return dict(zip(keys, stamp[layer, row, col][near].tolist(), strict=True))

    def _refresh(self, sdf: SdfQuery, stale: dict[tuple[int, int, int], int], *, with_normals: bool) -> None:
        """Look for crossings in the given blocks, all in one query."""
        if not stale:
            return
        cells, corner = self._active_cells(np.array(list(stale)))
        points = crossings(sdf, cells, corner, self._spacing_m)
        edge = self._occupancy.config.voxel_m
        points = points[self._occupancy.near_occupied(points, REACH_VOXELS * edge)]
        normals = gradient_directions(sdf, points) if with_normals else None
        points = points.astype(np.float32)
        # A crossing belongs to the block of its nearest voxel, so that each is stored once.
        owner = np.floor_divide(np.rint(points / edge).astype(np.int64), BLOCK)
        order = np.lexsort(owner.T)
        first = np.flatnonzero((np.diff(owner[order], axis=0, prepend=np.nan) != 0).any(axis=1))
        found = {tuple(owner[rows[0]].tolist()): rows for rows in np.split(order, first[1:]) if len(rows)}
        none = np.zeros(0, np.int64)
        for key, stamp in stale.items():
            mine = found.get(key, none)
            self._patches[key] = _Patch(stamp, points[mine], None if normals is None else normals[mine])

    def _active_cells(
        self, blocks: Int64[np.ndarray, "n 3"]
    ) -> tuple[Bool[np.ndarray, "x y z"], Int64[np.ndarray, "3"]]:
        """Which lattice cells touch an occupied voxel of the given blocks, and the index of the first cell."""
        places = (blocks - self._occupancy.corner // BLOCK)[:, ::-1]
        occupied = blocks_of(self._occupancy.grid.state)[tuple(places.T)] == OCCUPIED
        corner, touched = self._touched_cells(blocks)
        # As counts, axis by axis: which voxels touch a cell along one axis does not depend on the others.
        count = occupied.astype(np.float32) @ touched[:, 0, None]
        count = touched[:, 1, None].swapaxes(-1, -2) @ count
        count = np.einsum("bzi,bzyx->biyx", touched[:, 2], count, optimize=True)
        block, z, y, x = np.nonzero(count > 0.0)
        if not len(block):
            return np.zeros((0, 0, 0), bool), np.zeros(3, np.int64)
        cell = corner[block] + np.stack((x, y, z), axis=1)
        low = cell.min(axis=0)
        cells = np.zeros(cell.max(axis=0) - low + 1, bool)
        cells[tuple((cell - low).T)] = True
        return cells, low

    def _touched_cells(
        self, blocks: Int64[np.ndarray, "n 3"]
    ) -> tuple[Int64[np.ndarray, "n 3"], Float32[np.ndarray, "n 3 voxels cells"]]:
        """The first lattice cell at each block, and whether a voxel touches each cell from there on (0, 1), by axis."""
        per_voxel = self._occupancy.config.voxel_m / self._spacing_m
        voxel = blocks[:, :, None] * BLOCK + np.arange(BLOCK)
        low = np.floor((voxel - 0.5) * per_voxel + 1e-6).astype(np.int64)
        high = np.floor((voxel + 0.5) * per_voxel - 1e-6).astype(np.int64)
        first = low[:, :, 0]
        cell = first[:, :, None, None] + np.arange((high[:, :, -1] - first).max() + 1)
        return first, ((low[..., None] <= cell) & (cell <= high[..., None])).astype(np.float32)


def _within(
    patches: list[_Patch], centre_xy_m: Float[np.ndarray, "2"], radius_m: float
) -> tuple[Float32[np.ndarray, "n 3"], Bool[np.ndarray, " n"]]:
    """The points of patches, and which of them lie in the disc."""
    points = np.concatenate([np.zeros((0, 3), np.float32), *(p.xyz_m for p in patches)])
    return points, np.hypot(*(points[:, :2] - centre_xy_m).T) <= radius_m


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
    needed = corners_of(cells)
    values = np.zeros(needed.shape, np.float32)
    values[needed] = sdf((np.argwhere(needed) + corner) * spacing_m)
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


def gradient_directions(sdf: SdfQuery, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n 3"]:
    """Unit vectors along the SDF's gradient, from four differences on a tetrahedron about each point."""
    arms = _TETRAHEDRON * (_NORMAL_STEP_M / np.sqrt(3.0))
    values = sdf((points_m[:, None] + arms).reshape(-1, 3)).reshape(-1, 4)
    gradient = values @ _TETRAHEDRON.astype(np.float32)
    length = np.linalg.norm(gradient, axis=1, keepdims=True)
    flat = length[:, 0] < 1e-9
    gradient[flat] = (0.0, 0.0, 1.0)
    return (gradient / np.where(flat[:, None], 1.0, length)).astype(np.float32)
