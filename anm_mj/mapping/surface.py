"""Points on the zero-crossing of the SDF, where something was observed; kept per block between calls."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32

from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.lattice import crossings, touched_cells
from anm_mj.mapping.occupancy_kernels import BLOCK
from anm_mj.types import SdfQuery
from anm_mj.utils.arrays import numbers_of

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
    normal: Float32[np.ndarray, "n 3"]
    """Zero for points that nobody asked for the normals of."""
    normals_up_to_m: float
    """Points up to this height have normals [m]."""


class SurfaceExtractor:
    """Finds zero-crossings on the edges of a lattice and remembers them for blocks that no new frame has touched.

    Only lattice cells that touch an occupied voxel are looked at: elsewhere the field's sign is its own invention.
    """

    def __init__(self, occupancy: DepthOccupancy, spacing_m: float) -> None:
        self._occupancy = occupancy
        self._spacing_m = spacing_m
        self._patches: dict[tuple[int, int, int], _Patch] = {}

    def extract(
        self, sdf: SdfQuery, centre_xy_m: Float[np.ndarray, "2"], radius_m: float, max_height_m: float = np.inf
    ) -> tuple[Float32[np.ndarray, "n 3"], Float32[np.ndarray, "n 3"]]:
        """Points and unit normals (into free space) within ``radius_m`` of a place in the plane, in the world [m].

        A block's points are those at the time of the last frame that had a hit in it. Those above ``max_height_m`` are
        left out: normals cost four queries each.
        """
        patches = self._up_to_date(sdf, centre_xy_m, radius_m, normals_up_to_m=max_height_m)
        points, inside = _within(patches, centre_xy_m, radius_m)
        inside &= points[:, 2] <= max_height_m
        return points[inside], np.concatenate([np.zeros((0, 3), np.float32), *(p.normal for p in patches)])[inside]

    def places(self, sdf: SdfQuery, centre_xy_m: Float[np.ndarray, "2"], radius_m: float) -> Float32[np.ndarray, "n 3"]:
        """The points alone."""
        patches = self._up_to_date(sdf, centre_xy_m, radius_m, normals_up_to_m=-np.inf)
        points, inside = _within(patches, centre_xy_m, radius_m)
        return points[inside]

    def _up_to_date(
        self, sdf: SdfQuery, centre_xy_m: Float[np.ndarray, "2"], radius_m: float, *, normals_up_to_m: float
    ) -> list[_Patch]:
        """The patches that reach into the disc, after those that a frame has touched were updated."""
        stamps = self._blocks_about(centre_xy_m, radius_m)
        stale = {
            key: stamp
            for key, stamp in stamps.items()
            if (patch := self._patches.get(key)) is None
            or patch.stamp != stamp
            or patch.normals_up_to_m < normals_up_to_m
        }
        self._refresh(sdf, stale, normals_up_to_m)
        return [self._patches[key] for key in stamps]

    def _blocks_about(self, centre_xy_m: Float[np.ndarray, "2"], radius_m: float) -> dict[tuple[int, int, int], int]:
        """Blocks with hits that reach into the disc, by x, y, z indices, and the frames that last hit them."""
        block, stamp = self._occupancy.blocks_with_hits()
        edge_m = BLOCK * self._occupancy.config.voxel_m
        centre = (block[:, :2] + 0.5) * edge_m
        near = np.hypot(*(centre - centre_xy_m).T) <= radius_m + edge_m
        keys = [(int(x), int(y), int(z)) for x, y, z in block[near]]
        return dict(zip(keys, stamp[near].tolist(), strict=True))

    def _refresh(self, sdf: SdfQuery, stale: dict[tuple[int, int, int], int], normals_up_to_m: float) -> None:
        """Look for crossings in the given blocks, all in one query."""
        if not stale:
            return
        edge = self._occupancy.config.voxel_m
        state, corner, blocks = self._occupancy.grid.state, self._occupancy.voxels.corner, np.array(list(stale))
        points = crossings(sdf, *touched_cells(state, corner, blocks, edge / self._spacing_m), self._spacing_m)
        points = points[self._occupancy.near_occupied(points, REACH_VOXELS * edge)]
        placed = points.astype(np.float32)
        normals = np.zeros(points.shape, np.float32)
        asked = placed[:, 2] <= normals_up_to_m
        if asked.any():
            normals[asked] = gradient_directions(sdf, points[asked])
        # A crossing belongs to the block of its nearest voxel, so that each is stored once.
        owner = numbers_of(np.floor_divide(np.rint(placed / edge).astype(np.int64), BLOCK))
        order = np.argsort(owner, kind="stable")
        wanted = numbers_of(blocks)
        begin, end = (np.searchsorted(owner[order], wanted, side).tolist() for side in ("left", "right"))
        for (key, stamp), first, last in zip(stale.items(), begin, end, strict=True):
            mine = order[first:last]
            self._patches[key] = _Patch(stamp, placed[mine], normals[mine], normals_up_to_m)


def _within(
    patches: list[_Patch], centre_xy_m: Float[np.ndarray, "2"], radius_m: float
) -> tuple[Float32[np.ndarray, "n 3"], Bool[np.ndarray, " n"]]:
    """The points of patches, and which of them lie in the disc."""
    points = np.concatenate([np.zeros((0, 3), np.float32), *(p.xyz_m for p in patches)])
    return points, np.hypot(*(points[:, :2] - centre_xy_m).T) <= radius_m


def gradient_directions(sdf: SdfQuery, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n 3"]:
    """Unit vectors along the SDF's gradient, from four differences on a tetrahedron about each point."""
    arms = _TETRAHEDRON * (_NORMAL_STEP_M / np.sqrt(3.0))
    values = sdf((points_m[:, None] + arms).reshape(-1, 3)).reshape(-1, 4)
    gradient = values @ _TETRAHEDRON.astype(np.float32)
    length = np.linalg.norm(gradient, axis=1, keepdims=True)
    flat = length[:, 0] < 1e-9
    gradient[flat] = (0.0, 0.0, 1.0)
    return (gradient / np.where(flat[:, None], 1.0, length)).astype(np.float32)
