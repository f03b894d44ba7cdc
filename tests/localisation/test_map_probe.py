"""What the occupancy grid says of a frame at a pose."""

import numpy as np
import pytest

from anm_mj.frames import back_project, transform_points
from anm_mj.localisation.map_probe import agreement
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.mapping_config import OccupancyConfig
from anm_mj.types import OCCUPIED, Pose2
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
    within, wall = np.array([[0.8, 0.1, 1.0]]), np.array([[2.0, 0.1, 1.2]])
    assert (grid.state_at(within), grid.state_at(wall)) == ([OCCUPIED], [OCCUPIED])
    assert agreement(points, seen.T_world_camera, grid).share > 0.99
    # What is held is the free space that was seen, of each of the pixels that look through the disc, too.
    through = np.abs(points[:, 0] / points[:, 2]) < 0.3
    assert through.sum() > 20
    assert not agreement(points[through], seen.T_world_camera, grid).contradicted.any()
    # What is measured to be there hides what is behind it.
    beyond = seen.T_world_camera[:3, 3] + (wall - seen.T_world_camera[:3, 3]) / 0.8
    own = transform_points(np.linalg.inv(seen.T_world_camera), beyond).astype(np.float32)
    assert agreement(own, seen.T_world_camera, grid).contradicted == [True]
