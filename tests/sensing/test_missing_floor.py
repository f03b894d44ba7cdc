from dataclasses import replace

import numpy as np
import pytest

from anm_mj.frames import pixel_directions, world_to_cell
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.mapping_config import OccupancyConfig
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.scan_grid import ScanGrid
from anm_mj.planning.topdown_mapper import TopDownMapper
from anm_mj.sensing.missing_floor import FLOOR_M, LOOKS, SQUARE_M, MissingFloor
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, Footprint, Intrinsics, Observation, Pose2
from tests.planning.worlds import topdown_map

BODY = Footprint(0.18, 0.05, 1.35)
CAMERA = Intrinsics(128, 128, 64.0, 64.0, 64.0, 64.0)
HEIGHT_M = 1.25
HOLE = (3.0, 1.0, 4.0, 2.0)
"""x and y of the corners of a hole in the floor that nothing lies below [m]."""


def view(x_m=1.2, y_m=1.5, hole=HOLE, in_hole=np.nan, height_m=HEIGHT_M):
    """What a level camera that looks along x sees of a floor with a hole, and of a wall at x = 6 m."""
    T = np.eye(4)
    T[:3, :3] = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    T[:3, 3] = x_m, y_m, height_m
    ray = pixel_directions(CAMERA) @ T[:3, :3].T
    with np.errstate(divide="ignore"):
        to_floor = np.where(ray[..., 2] < 0, -height_m / ray[..., 2], np.inf)
    depth = np.minimum(to_floor, (6.0 - x_m) / ray[..., 0])
    place = T[:2, 3] + ray[..., :2] * np.minimum(to_floor, 1e6)[..., None]
    x0, y0, x1, y1 = hole
    inside = (place[..., 0] > x0) & (place[..., 0] < x1) & (place[..., 1] > y0) & (place[..., 1] < y1)
    depth = np.where(inside & (depth == to_floor), in_hole, depth).astype(np.float32)
    image = np.zeros((*depth.shape, 3), np.uint8)
    return Observation(0, 0.0, image, depth, CAMERA, T, Pose2(x_m, y_m, 0.0))


def far_away(points_m):
    return np.full(len(points_m), 0.1, np.float32)


def look(floor, observation):
    return floor.look(observation.depth_m, observation.intrinsics, observation.T_world_camera, observation.range_m)


def looked(observation, views=LOOKS):
    floor = MissingFloor()
    for _ in range(views):
        look(floor, observation)
    return floor


def cells(floor):
    return {tuple(cell) for cell in np.floor(floor.places_xy_m() / SQUARE_M).astype(int).tolist()}


def test_a_hole_that_nothing_is_measured_in_is_missing_floor_and_the_floor_about_it_is_not():
    floor = MissingFloor()
    for x_m in np.arange(0.6, 2.0, 0.065):
        look(floor, view(x_m))
    found = cells(floor)
    assert {(col, row) for col in range(62, 78) for row in range(22, 38)} <= found
    assert all(59 <= col <= 80 and 19 <= row <= 40 for col, row in found)


def test_a_few_views_are_not_enough():
    assert not cells(looked(view(), LOOKS - 1))


def test_a_look_returns_what_is_missing_about_where_it_looked():
    floor = looked(view(), LOOKS - 1)
    found = look(floor, view())
    assert len(found)
    assert np.array_equal(found, floor.places_xy_m())
    assert not len(look(floor, view(x_m=-20.0)))


def test_floor_that_is_measured_more_often_than_not_is_there():
    floor = looked(view())
    assert cells(floor)
    for _ in range(LOOKS):
        look(floor, view(hole=(4.3, 2.5, 4.4, 2.6)))
    assert not cells(floor)


def test_a_few_views_of_the_floor_outweigh_many_that_a_dark_thing_hid_it_from():
    floor = looked(view(), 4 * LOOKS)
    assert cells(floor)
    for _ in range(LOOKS):
        look(floor, view(hole=(4.3, 2.5, 4.4, 2.6)))
    assert not cells(floor)


def test_floor_behind_a_thing_that_loses_pixels_at_its_edges_is_not_missing():
    lost_in = np.random.default_rng(0)
    floor = MissingFloor()
    for _ in range(5 * LOOKS):
        thing = view(in_hole=1.0)
        thing.depth_m[(thing.depth_m == 1.0) & (lost_in.random(thing.depth_m.shape) < 0.3)] = np.nan
        look(floor, thing)
    assert not cells(floor)


def test_single_lost_pixels_are_no_hole():
    assert not cells(looked(view(hole=(3.0, 1.5, 3.1, 1.6))))


def test_views_that_are_lost_as_a_whole_tell_nothing():
    dark = view()
    assert not cells(looked(replace(dark, depth_m=np.full_like(dark.depth_m, np.nan)), 50))


def test_a_camera_that_says_that_it_looked_farther_needs_no_counting():
    assert not cells(looked(view(in_hole=np.inf), 50))


def test_a_camera_close_to_the_floor_is_not_expected_to_measure_it():
    assert not cells(looked(view(height_m=0.15, x_m=2.5), 50))


def test_floor_beyond_three_quarters_of_the_range_is_not_expected_to_be_measured():
    assert not cells(looked(replace(view(), range_m=2.0), 50))


@pytest.mark.parametrize("voxel_m", [0.02, 0.05, 0.1])
def test_the_voxels_of_a_square_reach_from_right_below_the_floor_to_it(voxel_m):
    squares = np.array([[0.325 + SQUARE_M * k, -0.175] for k in range(6)])
    voxels = MissingFloor().voxels(squares, voxel_m)
    x, y, z = (np.unique(axis) for axis in voxels.T)
    # Without gaps, and no more than half a voxel beyond the squares.
    assert (np.diff(x) == 1).all()
    assert x[0] * voxel_m >= 0.3 - voxel_m / 2 - 1e-9
    assert x[-1] * voxel_m <= 0.6 + voxel_m / 2 + 1e-9
    assert y[0] * voxel_m <= -0.175 <= y[-1] * voxel_m + voxel_m
    assert abs(z[0] * voxel_m + FLOOR_M) < 1e-9
    assert z[-1] == 0


@pytest.mark.parametrize("views", [LOOKS - 1, LOOKS])
def test_a_map_has_no_floor_where_it_was_looked_for_in_vain(views):
    grid = DepthOccupancy(OccupancyConfig())
    for _ in range(views):
        seen = view()
        grid.integrate(seen.depth_m, seen.intrinsics, seen.T_world_camera)
    hole = grid.state_at(np.array([[3.3, 1.5, z] for z in (-0.1, -0.05, 0.0)]))
    assert (hole == (FREE if views == LOOKS else UNKNOWN)).all()
    assert grid.state_at(np.array([[2.7, 1.5, 0.0]])) == OCCUPIED
    topdown = topdown_map(TopDownMapper(PlanningConfig(), BODY), grid.grid, far_away, Pose2(1.2, 1.5, 0.0))
    row, col = world_to_cell(np.array([[3.3, 1.5]]), topdown.origin_xy_m, topdown.resolution_m)[0]
    assert topdown.no_floor[row, col] == (views == LOOKS)


def test_floor_that_turns_out_to_be_there_fills_the_hole_again():
    grid = DepthOccupancy(OccupancyConfig())
    for hole in (HOLE,) * LOOKS + ((4.3, 2.5, 4.4, 2.6),) * (LOOKS + 3):
        seen = view(hole=hole)
        grid.integrate(seen.depth_m, seen.intrinsics, seen.T_world_camera)
    assert grid.state_at(np.array([[3.3, 1.5, 0.0]])) == OCCUPIED


def test_a_scanning_robot_does_not_either():
    grid = ScanGrid(BODY, 5.0)
    for _ in range(LOOKS):
        grid.integrate(view())
    topdown = grid.topdown()
    row, col = np.floor((np.array([1.5, 3.5]) - topdown.origin_xy_m[::-1]) / topdown.resolution_m).astype(int)
    assert topdown.state[row, col] == OCCUPIED
    assert topdown.state[row, col - 20] == FREE
