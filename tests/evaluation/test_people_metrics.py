import numpy as np
import pytest

from anm_mj.evaluation.people_metrics import surface_lost_percent
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, OccupancyGrid


def test_surface_that_was_carved_away_is_lost():
    """A wall of 20 x 20 voxels with a hole of 9 x 9, of which points less than three voxels inside are near the rim."""
    state = np.full((20, 20, 20), FREE, np.int8)
    state[:, :, 10] = OCCUPIED
    state[5:14, 5:14, 10] = FREE
    state[0, 0, 10] = UNKNOWN
    grid = OccupancyGrid(state, np.zeros(state.shape, np.float32), np.array([1.0, 0.0, -1.0]), 0.05)
    z, y = np.mgrid[:20, :20].reshape(2, -1)
    wall_m = np.stack([np.full(400, 10), y, z], axis=1) * 0.05 + 0.025 + grid.origin_m

    assert surface_lost_percent(grid, wall_m) == pytest.approx(100.0 * 25 / 400)
    assert surface_lost_percent(grid, wall_m + np.array([9.0, 0.0, 0.0])) == 0.0
    assert surface_lost_percent(grid, wall_m[:0]) is None
