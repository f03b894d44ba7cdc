import numpy as np
import pytest

from anm_mj.errors import PlanError
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.mapping_config import OccupancyConfig
from anm_mj.planning.change_reader import ChangeReader
from anm_mj.types import UNKNOWN, OccupancyGrid
from anm_mj.utils.arrays import embed
from tests.mapping.ray_room import Room


def grid_with(column_version, version):
    state = np.full((1, 8, 12), UNKNOWN, np.int8)  # Blocks of 4 x 4 columns of 1 m.
    return OccupancyGrid(state, np.full(state.shape, np.inf, np.float32), np.zeros(3), 1.0, version, column_version)


def test_takes_every_change_of_a_grid_that_grows():
    room, occupancy, reader = Room(), DepthOccupancy(OccupancyConfig()), ChangeReader()
    before = np.full((128, 256, 256), UNKNOWN, np.int8)
    for step, yaw in enumerate((0.0, 0.3, 1.5, 3.0, 3.0)):
        view = room.observe(2.0, 1.5, yaw, step=step)
        occupancy.integrate(view.depth_m, view.intrinsics, view.T_world_camera)
        grid = occupancy.grid
        start = occupancy.voxels.corner[::-1] + np.array([64, 128, 128])
        state = embed(grid.state, before.shape, start, UNKNOWN)
        outside = np.ones(grid.state.shape[1:], bool)
        window = reader.take(grid)
        if window is not None:
            outside[window] = False
        assert not (state != before)[:, embed(outside, before.shape[1:], start[1:], True)].any()
        before = state


def test_takes_a_change_once():
    versions = np.zeros((2, 3), np.int32)
    versions[1, 2] = 5
    reader = ChangeReader()
    assert reader.take(grid_with(versions, 5)) == (slice(4, 8), slice(8, 12))
    assert reader.take(grid_with(versions, 6)) is None


def test_leaves_what_lies_outside_the_box():
    versions = np.full((2, 3), 5, np.int32)
    reader = ChangeReader()
    assert reader.take(grid_with(versions, 5), np.array([[0.0, 1.0], [7.5, 2.0]])) == (slice(0, 4), slice(0, 8))
    assert reader.take(grid_with(versions, 5)) == (slice(0, 8), slice(0, 12))


def test_untracked_grid_is_read_as_a_whole():
    reader = ChangeReader()
    for _ in range(2):
        assert reader.take(grid_with(None, 0)) == (slice(0, 8), slice(0, 12))


def test_a_grid_that_holds_nothing_is_refused():
    with pytest.raises(PlanError, match="give it and the policy an observation"):
        ChangeReader().take(DepthOccupancy(OccupancyConfig()).grid)
