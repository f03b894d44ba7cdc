"""What an occupancy grid knew, carried along with keyframes whose poses were corrected."""

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from anm_mj.mapping.occupancy_kernels import BLOCK, VoxelArrays
from anm_mj.types import OCCUPIED, UNKNOWN


def carry(
    before: VoxelArrays,
    after: VoxelArrays,
    T_world_before: Float[np.ndarray, "m 4 4"],
    T_world_after: Float[np.ndarray, "m 4 4"],
    voxel_m: float,
    frame: int,
) -> None:
    """Fill what the grid ``after`` does not know with what the one ``before`` knew, in place, moved as the keyframe
    nearest to it was. Columns are moved as a whole along the floor, to the nearest column.

    The poses, camera to world, are those of the same keyframes that each grid was made with. ``frame`` is the number at
    which blocks count as changed.
    """
    layers, rows, cols = after.state.shape
    y, x = np.mgrid[:rows, :cols].reshape(2, -1) + after.corner[1::-1, None]
    place_m = np.stack((x, y), axis=1) * voxel_m
    _, nearest = KDTree(T_world_after[:, :2, 3]).query(place_m)
    back = T_world_before @ np.linalg.inv(T_world_after)
    # At the camera's height: only a camera that tilts otherwise than before would move columns by their height.
    offset = back[:, :2, 2] * T_world_after[:, 2, 3:] + back[:, :2, 3]
    source_m = np.einsum("nij,nj->ni", back[nearest, :2, :2], place_m) + offset[nearest]
    col, row = (np.rint(source_m / voxel_m).astype(np.int64) - before.corner[:2]).T
    inside = (row >= 0) & (row < before.state.shape[1]) & (col >= 0) & (col < before.state.shape[2])
    target = np.flatnonzero(inside)
    source = (row * before.state.shape[2] + col)[inside]
    up = int(after.corner[2] - before.corner[2])
    for layer in range(max(0, -up), min(layers, len(before.state) - up)):
        # Layer by layer: all at once would take several times the memory of the grid.
        known = before.state[layer + up].ravel()[source] != UNKNOWN
        known &= after.state[layer].ravel()[target] == UNKNOWN
        into, out_of = target[known], source[known]
        for name in ("log_odds", "state", "seen_range_m", "num_hits"):
            getattr(after, name)[layer].reshape(-1)[into] = getattr(before, name)[layer + up].reshape(-1)[out_of]
        # Blocks of free space alone hold nothing to mesh or to learn.
        is_hit = (after.num_hits[layer] > 0) | (after.state[layer] == OCCUPIED)
        hit = into[is_hit.reshape(-1)[into]]
        after.block_stamp[layer // BLOCK].reshape(-1)[
            np.unique(hit // cols // BLOCK * (cols // BLOCK) + hit % cols // BLOCK)
        ] = frame
