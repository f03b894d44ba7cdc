"""Robot-centred occupancy map of an episode: the optional ``topdown`` entry of an observation."""

import numpy as np
from jaxtyping import Float32, Float64, Int8
from scipy.ndimage import distance_transform_edt

from anm_mj.frames import cell_to_world, pose_matrix
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.mapping_config import OccupancyConfig
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, Footprint, Observation, OccupancyGrid, Pose2

CELLS = 192
"""Rows and columns of the map; its side is 9.6 m."""
FREE_FRACTION = 0.5
"""Fraction of a column's voxels that must be free for the column to be free."""
MAX_DISTANCE_M = 2.0


def _information_bits() -> Float64[np.ndarray, "256"]:
    """Bits known of a voxel by its log-odds in tenths, in the order of the bytes of an int8."""
    log_odds = np.arange(256, dtype=np.uint8).view(np.int8) / 10.0
    p = 1.0 / (1.0 + np.exp(-log_odds))
    return 1.0 + p * np.log2(p) + (1.0 - p) * np.log2(1.0 - p)


_INFORMATION_BITS = _information_bits()


class LocalMap:
    """Fuses depth into an occupancy grid and crops the robot's surroundings from it."""

    def __init__(self, footprint: Footprint) -> None:
        """Start with an unknown map; the heights of ``footprint`` bound the columns."""
        self._footprint = footprint
        self._grid = DepthOccupancy(OccupancyConfig())
        # Of cell centres in base axes: row 0 is the farthest x (forward), column 0 the farthest y (left).
        self._offsets_m = (CELLS / 2 - 0.5 - np.arange(CELLS)) * self._grid.config.voxel_m

    def add(self, observation: Observation) -> None:
        """Add a view."""
        self._grid.integrate(
            observation.depth_m, observation.intrinsics, observation.T_world_camera, observation.range_m
        )

    @property
    def area_m2(self) -> float:
        """Area of the columns in which anything was observed at the body's heights [m2]."""
        grid = self._grid.grid
        body = grid.state[grid.layers_between(self._footprint.z_min_m, self._footprint.z_max_m)]
        return float((body != UNKNOWN).any(axis=0).sum()) * grid.resolution_m**2

    @property
    def information_bits(self) -> float:
        """What the grid knows [bits]: one per voxel, less its entropy; 0 where nothing was observed."""
        # Histogram first: there are only 256 different log-odds.
        counts = np.bincount(self._grid.voxels.log_odds.reshape(-1).view(np.uint8), minlength=256)
        return float(counts @ _INFORMATION_BITS)

    def distance(self, pose: Pose2) -> Float32[np.ndarray, "rows cols"]:
        """Signed distance to the nearest obstacle around a pose, in the cells of :meth:`crop` [m]. Positive outside of
        obstacles, negative inside, and limited to ``MAX_DISTANCE_M``. Unknown cells are no obstacles.
        """
        occupied = self.crop(pose) == OCCUPIED
        edge = self._grid.config.voxel_m
        if not occupied.any():
            return np.full(occupied.shape, MAX_DISTANCE_M, np.float32)
        outside, inside = (np.asarray(distance_transform_edt(where)) for where in (~occupied, occupied))
        # Centres of neighbouring cells lie one edge apart, the border between them half an edge from both.
        signed = np.where(occupied, 0.5 - inside, outside - 0.5) * edge
        return np.clip(signed, -MAX_DISTANCE_M, MAX_DISTANCE_M).astype(np.float32)

    def crop(self, pose: Pose2) -> Int8[np.ndarray, "rows cols"]:
        """The map around a pose: row 0 ahead, column 0 to the left, cells of 5 cm. Returns OCCUPIED where any voxel at
        the body's heights is occupied, FREE where at least half of them are free, else UNKNOWN.
        """
        grid = self._grid.grid
        T_world_base = pose_matrix(pose)
        # Cells lie along two axes: their indices are sums of one number per row and one per column.
        ahead, left = self._offsets_m[:, None] * T_world_base[:2, 0], self._offsets_m[:, None] * T_world_base[:2, 1]
        corner = (pose.xy_m - grid.origin_m[:2]) / grid.resolution_m
        ahead, left = ahead / grid.resolution_m + corner, left / grid.resolution_m
        col, row = (np.floor(np.add.outer(ahead[:, k], left[:, k])).astype(np.int32) for k in range(2))
        low = np.maximum([row.min(), col.min()], 0)
        columns = _columns(grid, self._footprint, low, np.array([row.max(), col.max()]) + 1)
        row -= low[0]
        col -= low[1]
        inside = (row >= 0) & (col >= 0) & (row < columns.shape[0]) & (col < columns.shape[1])
        if inside.all():
            out = columns[row, col]
        else:
            out = np.full((CELLS, CELLS), UNKNOWN, np.int8)
            out[inside] = columns[row[inside], col[inside]]

        # Rotated cells miss some voxels, which would leave holes in thin walls.
        occupied_xy = cell_to_world(np.argwhere(columns == OCCUPIED) + low, grid.origin_m[:2], grid.resolution_m)
        base_xy = (occupied_xy - pose.xy_m) @ T_world_base[:2, :2]
        row, col = np.floor(CELLS / 2 - base_xy / grid.resolution_m).astype(np.int64).T
        inside = (row >= 0) & (row < CELLS) & (col >= 0) & (col < CELLS)
        out[row[inside], col[inside]] = OCCUPIED
        return out


def _columns(
    grid: OccupancyGrid, footprint: Footprint, low: np.ndarray, high: np.ndarray
) -> Int8[np.ndarray, "rows cols"]:
    """States of the columns over the body's heights, from ``[row, col]`` ``low`` to ``high`` (exclusive)."""
    heights = footprint.z_min_m, footprint.z_max_m
    body = grid.state[grid.layers_between(*heights), low[0] : max(high[0], 0), low[1] : max(high[1], 0)]
    num_free = np.add.reduce((body == FREE).view(np.uint8), axis=0, dtype=np.uint16)
    state = np.where(num_free >= FREE_FRACTION * grid.num_layers_between(*heights), np.int8(FREE), np.int8(UNKNOWN))
    state[body.max(axis=0, initial=UNKNOWN) == OCCUPIED] = OCCUPIED
    return state
