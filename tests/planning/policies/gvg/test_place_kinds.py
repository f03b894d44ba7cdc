import numpy as np
import pytest

from anm_mj.planning.policies.gvg.place_kinds import KINDS, PlaceKinds
from anm_mj.planning.policies.gvg.pooled_occupancy import PooledOccupancy
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, Pose2

CELLS = 80
"""Voxels of 5 cm along the room, of which x from 2 to 3 m is known only above 0.7 m, over a desk."""


@pytest.fixture
def occupancy():
    state = np.full((60, CELLS, CELLS), UNKNOWN, np.int8)
    state[:10] = UNKNOWN
    state[10, :, :40] = OCCUPIED
    state[11:, :, :40] = FREE
    state[10:24, :, 40:44] = OCCUPIED
    state[24:, :, 40:60] = FREE
    # No floor along the lower edge.
    state[:10, :10, :40] = state[10:, :10, :40] = FREE
    grid = OccupancyGrid(state, np.ones(state.shape, np.float32), np.array([0.0, 0.0, -0.5]), 0.05, 1)
    pooled = PooledOccupancy(5.5)
    pooled.update(grid, (slice(0, CELLS), slice(0, CELLS)))
    return pooled


@pytest.mark.parametrize(
    ("place_m", "is_deep", "kind"),
    [
        ((-0.05, 3.0, 1.0), False, "corner"),
        ((-0.05, 3.0, 1.0), True, "doorway"),
        ((2.5, 3.0, 0.3), False, "furniture"),
        ((3.1, 3.0, 1.0), True, "opening"),
        ((3.1, 3.0, 2.2), True, "high"),
        ((1.0, -0.3, 1.0), True, "outside"),
    ],
)
def test_kind_of_a_place(occupancy, place_m, is_deep, kind):
    kinds = PlaceKinds()
    kinds.update(occupancy, Pose2(1.0, 3.0, 0.0))
    cell = occupancy.flat_index(np.array([place_m]))
    assert occupancy.state.reshape(-1)[cell] == UNKNOWN
    assert KINDS[int(kinds.of(cell, np.array([is_deep]))[0])] == kind
