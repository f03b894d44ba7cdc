"""What the occupancy grid says of a frame at a pose."""

import numpy as np
import pytest

from anm_mj.frames import back_project
from anm_mj.localisation.occupancy_agreement import agreement
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.mapping_config import OccupancyConfig
from anm_mj.types import FREE, OCCUPIED, Pose2
from tests.box_room import observe


@pytest.fixture
def grid() -> DepthOccupancy:
    """The box room, looked at from its middle, to +x."""
    grid = DepthOccupancy(OccupancyConfig())
    seen = observe(0, Pose2(0.0, 0.0, 0.0))
    for _ in range(6):
        grid.integrate(seen.depth_m, seen.intrinsics, seen.T_world_camera)
    return grid


def test_a_frame_agrees_with_what_it_has_shown_and_not_from_elsewhere(grid):
    seen = observe(1, Pose2(0.0, 0.0, 0.0))
    points = back_project(seen.depth_m, seen.intrinsics, np.eye(4))[::50].astype(np.float32)
    assert agreement(points, seen.T_world_camera, grid).share > 0.99
    elsewhere = seen.T_world_camera.copy()
    elsewhere[0, 3] -= 0.5
    assert agreement(points, elsewhere, grid).share < 0.5


def test_somebody_who_is_taken_for_an_obstacle_contradicts_no_frame(grid):
    """The disc is larger than a person: what is seen past them lies behind it."""
    seen = observe(1, Pose2(0.0, 0.0, 0.0))
    points = back_project(seen.depth_m, seen.intrinsics, np.eye(4))[::50].astype(np.float32)
    grid.hold_moved(np.array([[0.8, 0.0, 0.4]]))
    within = np.array([[0.8, 0.1, 1.0]])
    assert (grid.state_at(within), grid.state_at(within, held=False)) == ([OCCUPIED], [FREE])
    assert agreement(points, seen.T_world_camera, grid).share > 0.99
    # What is measured to be there is an obstacle however it is asked for.
    wall = np.array([[2.0, 0.1, 1.2]])
    assert grid.state_at(wall) == grid.state_at(wall, held=False) == [OCCUPIED]
