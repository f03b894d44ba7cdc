import math
from dataclasses import replace

import numpy as np
import pytest

from anm_mj.errors import PlanError
from anm_mj.frames import cell_to_world, pixel_directions, world_to_cell
from anm_mj.planning.grid_route import GridRoutes
from anm_mj.planning.scan_grid import RESOLUTION_M, ScanGrid
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, Footprint, Observation, Pose2
from tests.box_room import ROOM_HIGH_M, ROOM_LOW_M, observe

FOOTPRINT = Footprint(0.18, 0.05, 1.35)


def look(pose: Pose2) -> Observation:
    return observe(0, pose)


def state_at(grid: ScanGrid, *xy_m: float) -> int:
    topdown = grid.topdown()
    row, col = world_to_cell(np.array([xy_m]), topdown.origin_xy_m, topdown.resolution_m)[0]
    return int(topdown.state[row, col])


def test_a_turn_in_a_room_shows_its_whole_floor_free_and_its_walls_closed():
    grid = ScanGrid(FOOTPRINT, 10.0)

    for k in range(36):
        grid.integrate(look(Pose2(0.0, 0.0, math.radians(10 * k))))

    topdown = grid.topdown()
    rows, cols = np.indices(topdown.state.shape)
    xy = cell_to_world(np.stack([rows.ravel(), cols.ravel()], axis=1), topdown.origin_xy_m, RESOLUTION_M)
    inside = ((xy > ROOM_LOW_M[:2] + RESOLUTION_M) & (xy < ROOM_HIGH_M[:2] - RESOLUTION_M)).all(axis=1)
    outside = ((xy < ROOM_LOW_M[:2] - RESOLUTION_M) | (xy > ROOM_HIGH_M[:2] + RESOLUTION_M)).any(axis=1)
    state = topdown.state.ravel()
    assert (state[inside] == FREE).all()
    assert (state[outside] == UNKNOWN).all()
    assert state_at(grid, 2.0, 0.0) == OCCUPIED


def test_nothing_behind_the_camera_is_told_about_but_the_ground_it_stands_on():
    grid = ScanGrid(FOOTPRINT, 10.0)

    grid.integrate(look(Pose2(0.0, 0.0, 0.0)))

    assert state_at(grid, 1.0, 0.0) == FREE
    assert state_at(grid, -0.1, 0.0) == FREE
    assert state_at(grid, -1.0, 0.0) == UNKNOWN


def test_a_limited_range_leaves_the_far_wall_unknown():
    grid = ScanGrid(FOOTPRINT, 1.5)

    grid.integrate(look(Pose2(0.0, 0.0, 0.0)))

    assert state_at(grid, 1.4, 0.0) == FREE
    assert state_at(grid, 1.7, 0.0) == UNKNOWN
    assert state_at(grid, 2.0, 0.0) == UNKNOWN


def test_the_rim_of_a_pit_is_an_obstacle():
    """From x = 1.4 m on the floor lies 1.5 m lower."""
    seen = look(Pose2(0.0, 0.0, 0.0))
    camera_m, rays = seen.T_world_camera[2, 3], pixel_directions(seen.intrinsics)
    down = np.maximum(rays[..., 1], 1e-6)
    over_the_pit = (camera_m / down > 1.4) & (camera_m / down < seen.depth_m + 1e-3)
    depth_m = np.where(over_the_pit, np.minimum((camera_m + 1.5) / down, 2.0), seen.depth_m)
    grid = ScanGrid(FOOTPRINT, 10.0)

    grid.integrate(replace(seen, depth_m=depth_m.astype(np.float32)))

    assert state_at(grid, 1.3, 0.0) == FREE
    assert state_at(grid, 1.42, 0.0) == OCCUPIED
    assert state_at(grid, 1.7, 0.0) == UNKNOWN

    # A pixel or two of noise are no pit.
    row, col = np.argwhere(over_the_pit & (np.abs(rays[..., 0]) < 0.05))[0]
    noisy_m = seen.depth_m.copy()
    noisy_m[row, col : col + 2] = depth_m[row, col : col + 2]
    level = ScanGrid(FOOTPRINT, 10.0)
    level.integrate(replace(seen, depth_m=noisy_m))
    assert OCCUPIED not in [state_at(level, x_m, 0.0) for x_m in np.arange(0.5, 1.9, 0.05)]


def test_growing_keeps_what_is_known_where_it_is():
    grid = ScanGrid(FOOTPRINT, 3.0)
    grid.integrate(look(Pose2(0.0, 0.0, 0.0)))
    before = grid.topdown()

    far = look(Pose2(0.0, 0.0, math.pi))
    far.T_world_camera[:2, 3] -= 20.0
    grid.integrate(far)

    after = grid.topdown()
    row, col = np.rint((before.origin_xy_m - after.origin_xy_m)[::-1] / RESOLUTION_M).astype(int)
    again = after.state[row : row + before.state.shape[0], col : col + before.state.shape[1]]
    known = before.state != UNKNOWN
    np.testing.assert_array_equal(again[known], before.state[known])
    assert after.state.size > before.state.size


def test_a_refused_step_puts_an_obstacle_before_the_robot():
    # So near to a wall that paths need no more clearance than that.
    grid, pose = ScanGrid(FOOTPRINT, 10.0), Pose2(0.5, ROOM_HIGH_M[1] - 0.14, 0.0)
    for k in range(6):
        grid.integrate(look(Pose2(0.0, 0.0, math.radians(60 * k))))

    def leads_to(x_m: float) -> bool:
        routes = GridRoutes(grid.topdown(), pose, FOOTPRINT.radius_m, RESOLUTION_M / 2)
        return math.isfinite(routes.cost_at(np.array([x_m, pose.y_m])))

    assert leads_to(0.5 + 0.065)
    grid.block_ahead(pose)
    assert state_at(grid, 0.5 + 0.18 + 0.065, pose.y_m) == OCCUPIED
    # What it touched need not lie straight ahead: the same step leads nowhere now, but the robot can go back.
    assert not leads_to(0.5 + 0.065)
    assert leads_to(0.4)


def test_marks_of_collisions_shrink_but_for_what_was_seen():
    grid = ScanGrid(FOOTPRINT, 10.0)
    grid.integrate(look(Pose2(0.3, 0.0, 0.0)))
    before = grid.topdown().state
    # One in the open, one whose mark reaches over the wall at x = 2 m.
    for x_m in (0.5, 1.7):
        grid.block_ahead(Pose2(x_m, 0.0, 0.0))
    large = np.count_nonzero(grid.topdown().state != before)
    nowhere = np.zeros((0, 2))
    assert grid.shrink_collisions(nowhere)
    after = grid.topdown().state
    small = np.count_nonzero(after != before)
    assert 0 < small < large / 2
    assert state_at(grid, 0.5 + 0.18 + 0.065, 0.0) == OCCUPIED
    assert (after[before == OCCUPIED] == OCCUPIED).all()
    assert not grid.shrink_collisions(nowhere)

    grid.block_ahead(Pose2(0.5, 0.0, 0.0))
    assert grid.shrink_collisions(np.array([[0.5 + 0.18 + 0.065, 0.0]]))
    assert state_at(grid, 0.5 + 0.18 + 0.065, 0.0) == FREE


def test_clearance_is_measured_to_surfaces_and_not_to_cells():
    """The wall at x = 2 m stands at the edge of a cell: to the cell's near side clearance would be half a cell off."""
    grid = ScanGrid(FOOTPRINT, 10.0)
    grid.integrate(look(Pose2(0.3, 0.0, 0.0)))

    topdown = grid.topdown()
    for x in (1.4, 1.52, 1.61, 1.77, 1.88):
        row, col = world_to_cell(np.array([[x, 0.0]]), topdown.origin_xy_m, RESOLUTION_M)[0]
        (centre,) = cell_to_world(np.array([[row, col]]), topdown.origin_xy_m, RESOLUTION_M)
        assert abs(float(topdown.clearance_m[row, col]) - (ROOM_HIGH_M[0] - centre[0])) < 0.005


def test_a_growing_grid_keeps_its_surfaces():
    grid = ScanGrid(FOOTPRINT, 3.0)
    grid.integrate(look(Pose2(0.0, 0.0, 0.0)))
    known = np.sort(grid.surface_m[np.isfinite(grid.surface_m)])
    far = look(Pose2(0.0, 0.0, math.pi))
    far.depth_m[:] = np.nan
    far.T_world_camera[:2, 3] -= 20.0
    grid.integrate(far)

    assert grid.surface_m.shape[1:] == grid.log_odds.shape
    np.testing.assert_array_equal(np.sort(grid.surface_m[np.isfinite(grid.surface_m)]), known)


def test_without_any_obstacle_clearance_is_large_everywhere():
    grid = ScanGrid(FOOTPRINT, 1.0)
    with pytest.raises(PlanError, match="give it and the policy an observation"):
        grid.topdown()
    grid.integrate(look(Pose2(3.0, 2.5, 0.0)))
    topdown = grid.topdown()
    assert not (topdown.state == OCCUPIED).any()
    assert (topdown.clearance_m >= topdown.state.shape[0] * RESOLUTION_M).all()
