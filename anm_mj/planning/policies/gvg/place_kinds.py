"""What kind of place unknown space is, as far as the map tells: places of one kind pay alike.

Unknown space beside free space that the robot could drive to is a corner, or a doorway where it goes deep. What is seen
only over or through something is behind furniture, or lies beyond an opening where it goes deep. By columns without a
floor begins the outside. Above people's heads is high, wherever it lies.
"""

import math

import numpy as np
from jaxtyping import Bool, Int, UInt8
from scipy import ndimage

from anm_mj.planning.distance_transform import capped_distance_cells
from anm_mj.planning.policies.gvg.pooled_occupancy import KNOWN, PooledOccupancy
from anm_mj.types import FREE, Pose2

KINDS = ("corner", "doorway", "furniture", "opening", "outside", "high")
"""Names; the deep kind of a column follows the shallow one."""
_HIGH = 5
_REACHED, _BEHIND, _OUTSIDE = 0, 2, 4
HIGH_M = 0.5
"""What is free from the floor up to here is open to a robot [m]."""
BESIDE_M = 0.15
"""So near to open columns unknown space is beside them [m]."""
HEAD_M = 1.8
"""Above this is high [m]."""
OUTSIDE_M = 1.0
"""So near to columns without a floor it is outside [m]."""


class PlaceKinds:
    """The kind of each column as of the last full decision."""

    def __init__(self) -> None:
        self._first_high = np.iinfo(np.int64).max
        """Flat index into the occupancy from which on all is high."""
        self._first: UInt8[np.ndarray, "rows cols"] = np.zeros((1, 1), np.uint8)
        self.epoch = -1
        """That of the occupancy whose columns it knows."""

    def update(self, occupancy: PooledOccupancy, pose: Pose2) -> None:
        """Judge all columns by the map as it is, and by where the robot stands."""
        self.epoch = occupancy.epoch
        floor, high = (max(math.floor((z - occupancy.origin_m[2]) / occupancy.cell_m + 1e-6), 0) for z in (0.0, HIGH_M))
        is_open = (occupancy.state[floor + 1 : high + 1] == FREE).all(axis=0)
        beside = _near(_reached(is_open, occupancy, pose), BESIDE_M / occupancy.cell_m)
        has_no_floor = (occupancy.state[max(floor - 1, 0) : high + 1] == KNOWN).all(axis=0)
        outside = _near(has_no_floor, OUTSIDE_M / occupancy.cell_m)
        self._first_high = math.ceil((HEAD_M - occupancy.origin_m[2]) / occupancy.cell_m) * is_open.size
        self._first = np.where(outside, _OUTSIDE, np.where(beside, _REACHED, _BEHIND)).astype(np.uint8)

    def of(self, cells: Int[np.ndarray, "*n"], is_deep: Bool[np.ndarray, "*n"]) -> UInt8[np.ndarray, "*n"]:
        """Index into ``KINDS`` of the places of unknown cells, given by flat indices into the occupancy."""
        first = self._first.reshape(-1)[cells % self._first.size]
        kind = first + (is_deep & (first != _OUTSIDE))
        return np.where((cells >= self._first_high) & (first != _OUTSIDE), np.uint8(_HIGH), kind)


def _reached(
    is_open: Bool[np.ndarray, "rows cols"], occupancy: PooledOccupancy, pose: Pose2
) -> Bool[np.ndarray, "rows cols"]:
    """The open columns that are connected with the one nearest to the robot."""
    if not is_open.any():
        return is_open
    label, _ = ndimage.label(is_open)  # pyright: ignore[reportGeneralTypeIssues]
    rows, cols = np.nonzero(is_open)
    row, col = (pose.xy_m[::-1] - occupancy.origin_m[1::-1]) / occupancy.cell_m - 0.5
    nearest = np.argmin((rows - row) ** 2 + (cols - col) ** 2)
    return label == label[rows[nearest], cols[nearest]]


def _near(mask: Bool[np.ndarray, "rows cols"], reach_cells: float) -> Bool[np.ndarray, "rows cols"]:
    return capped_distance_cells(~mask, int(reach_cells) + 1) <= reach_cells
