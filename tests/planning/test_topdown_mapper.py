from dataclasses import replace

import numpy as np
import pytest

from anm_mj.frames import world_to_cell
from anm_mj.planning.paths import clearance_at
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.topdown_mapper import TopDownMapper
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, Footprint, OccupancyGrid, Pose2
from tests.planning.worlds import RESOLUTION_M, BoxWorld, room, topdown_map

BODY = Footprint(0.18, 0.05, 1.35)


def topdown_of(world, pose, config=PlanningConfig()):  # noqa: B008
    return topdown_map(TopDownMapper(config, BODY), world.occupancy, world.sdf, pose)


def state_at(topdown, x, y):
    row, col = world_to_cell(np.array([[x, y]]), topdown.origin_xy_m, topdown.resolution_m)[0]
    return topdown.state[row, col]


def test_free_occupied_and_unknown_columns_are_told_apart():
    world = room(4, 3, boxes=[(2, 1, 2.5, 1.5)], unknown=[(3, 2, 4.2, 3.2)])
    topdown = topdown_of(world, Pose2(1, 1, 0))
    assert state_at(topdown, 1.0, 1.0) == FREE
    assert state_at(topdown, 2.2, 1.2) == OCCUPIED
    assert state_at(topdown, 3.6, 2.6) == UNKNOWN


def test_clearance_in_a_room_is_the_distance_to_the_nearest_wall():
    topdown = topdown_of(room(4, 3), Pose2(2, 1.5, 0))
    assert abs(clearance_at(topdown, np.array([[1.225, 1.725]]))[0] - 1.025) < 0.03
    assert clearance_at(topdown, np.array([[0.1, 1.0]]))[0] < 0


def test_zero_crossings_lie_on_the_wall_to_a_centimetre_although_cells_are_five():
    # The wall's face lies inside a cell, at 1.12 m: only the SDF knows where.
    world = BoxWorld((3, 3), [(0, 0, 1.10, 3)])
    world.boxes = np.array([[0, 0, 1.12, 3.0]])
    topdown = topdown_of(world, Pose2(2, 1.5, 0))
    near = topdown.surface_xy_m[np.abs(topdown.surface_xy_m[:, 1] - 1.5) < 1.0]
    assert len(near) > 10
    assert np.abs(near[:, 0] - 1.12).max() < 0.012


def test_an_extrapolated_sign_opens_no_way_into_the_unknown():
    world = room(4, 3, unknown=[(3, 0.2, 4.2, 3.2)])
    world.sdf = lambda points: np.full(len(points), 0.1, np.float32)
    assert state_at(topdown_of(world, Pose2(1, 1, 0)), 3.6, 1.0) == UNKNOWN


def test_small_enclosed_unknown_is_taken_as_free_and_large_is_not():
    config = PlanningConfig(hole_area_m2=0.15)
    small = topdown_of(room(4, 3, unknown=[(2, 1, 2.3, 1.3)]), Pose2(1, 1, 0), config)
    large = topdown_of(room(4, 3, unknown=[(2, 1, 2.6, 1.6)]), Pose2(1, 1, 0), config)
    assert state_at(small, 2.15, 1.15) == FREE
    assert state_at(large, 2.3, 1.3) == UNKNOWN


def test_for_a_wide_robot_a_wall_encloses_a_pocket_before_it():
    wall = (2.0, 0.2, 2.1, 2.2)
    world = room(4, 2, boxes=[wall], unknown=[(1.95, 1.0, 2.0, 1.1), (2.1, 0.2, 4.2, 2.2)])
    for body, pocket in ((Footprint(0.3, 0.05, 1.35), FREE), (BODY, UNKNOWN)):
        mapper = TopDownMapper(PlanningConfig(), body)
        topdown = topdown_map(mapper, world.occupancy, world.sdf, Pose2(1, 1.5, 0))
        assert topdown.state[20, 39] == pocket
        assert topdown.state[20, 60] == UNKNOWN


def test_remembered_sdf_stays_in_place_when_the_grid_grows():
    world = BoxWorld((3, 3), [(0, 0, 1.10, 3)])
    world.boxes = np.array([[0, 0, 1.12, 3.0]])
    mapper = TopDownMapper(PlanningConfig(), BODY)
    before = topdown_map(mapper, world.occupancy, world.sdf, Pose2(2, 1.5, 0))
    old = world.occupancy
    grown = OccupancyGrid(
        np.pad(old.state, ((0, 0), (20, 0), (40, 0)), constant_values=UNKNOWN),
        np.pad(old.seen_range_m, ((0, 0), (20, 0), (40, 0)), constant_values=np.inf),
        old.origin_m - np.array([2.0, 1.0, 0.0]),
        old.resolution_m,
    )
    # Far from the wall nothing is asked again, so what is known of it must have been kept.
    after = topdown_map(mapper, grown, lambda points: np.full(len(points), np.nan, np.float32), Pose2(40.0, 40.0, 0))
    near = after.surface_xy_m[(np.abs(after.surface_xy_m[:, 1] - 1.5) < 0.5) & (after.surface_xy_m[:, 0] > 1.0)]
    assert np.abs(near[:, 0] - 1.12).max() < 0.012
    assert len(before.surface_xy_m) > 0


def test_floor_that_the_robot_stood_on_is_free_once_the_grid_holds_it():
    """A camera ahead of the base may see nothing of the block of voxels that the base stands in."""
    grid = BoxWorld((3, 3), []).occupancy
    nothing = lambda points: np.full(len(points), 0.1, np.float32)  # noqa: E731
    pad = ((0, 0), (0, 0), (60, 0))
    grown = replace(
        grid,
        state=np.pad(grid.state, pad, constant_values=UNKNOWN),
        seen_range_m=np.pad(grid.seen_range_m, pad, constant_values=np.inf),
        origin_m=grid.origin_m - np.array([60, 0, 0]) * RESOLUTION_M,
    )
    mapper = TopDownMapper(PlanningConfig(), BODY)
    for x in (-1.5, -1.0, 0.5):
        topdown_map(mapper, grid, nothing, Pose2(x, 1.5, 0.0))
    topdown = topdown_map(mapper, grown, nothing, Pose2(0.6, 1.5, 0.0))
    # About the start the floor is free farther than under the body.
    assert [state_at(topdown, x, 1.5) for x in (-2.1, -1.5, -1.0)] == [FREE] * 3
    assert state_at(topdown, -2.5, 1.5) == UNKNOWN


def test_borders_stay_in_place_when_the_grid_grows_and_nothing_else_changes():
    block, more = 8, 64
    grid, pose = room(12, 12).occupancy, Pose2(6.2, 6.2, 0)
    version = np.ones(np.array(grid.state.shape[1:]) // block, np.int32)
    mapper = TopDownMapper(PlanningConfig(), BODY)
    far = lambda points: np.full(len(points), 0.1, np.float32)  # noqa: E731
    before = topdown_map(mapper, replace(grid, column_version=version, version=1), far, pose)
    pad = ((0, 0), (more, 0), (more, 0))
    grown = replace(
        grid,
        state=np.pad(grid.state, pad, constant_values=UNKNOWN),
        seen_range_m=np.pad(grid.seen_range_m, pad, constant_values=np.inf),
        origin_m=grid.origin_m - np.array([more, more, 0]) * RESOLUTION_M,
        column_version=np.pad(version, ((more // block, 0), (more // block, 0))),
        version=2,
    )
    after = topdown_map(mapper, grown, far, pose)
    assert len(before.surface_xy_m) > 100
    assert np.allclose(np.sort(after.surface_xy_m, axis=0), np.sort(before.surface_xy_m, axis=0))


def test_a_place_that_blocked_the_robot_is_an_obstacle_from_then_on():
    world = room(4, 3)
    mapper = TopDownMapper(PlanningConfig(), BODY)
    mapper.add_collision(np.array([2.0, 2.0]))
    topdown = topdown_map(mapper, world.occupancy, world.sdf, Pose2(1, 1, 0))
    assert state_at(topdown, 2.0, 2.0) == OCCUPIED


def test_what_blocked_the_robot_is_drawn_smaller_once():
    world = room(4, 3)
    mapper = TopDownMapper(PlanningConfig(), BODY)
    assert not mapper.shrink_collisions()
    mapper.add_collision(np.array([2.0, 2.0]))
    before = topdown_map(mapper, world.occupancy, world.sdf, Pose2(1, 1, 0))
    assert mapper.shrink_collisions()
    after = topdown_map(mapper, world.occupancy, world.sdf, Pose2(1, 1, 0))
    assert state_at(after, 2.0, 2.0) == OCCUPIED
    assert state_at(before, 2.08, 2.0) == OCCUPIED
    assert state_at(after, 2.08, 2.0) == FREE
    assert not mapper.shrink_collisions()


def test_a_ring_of_unknown_floor_about_the_start_is_bridged():
    world = room(6, 6)
    grid = world.occupancy
    y, x = (np.indices(grid.state.shape[1:]) + 0.5) * RESOLUTION_M + grid.origin_m[1::-1][:, None, None]
    away = np.hypot(x - 3.0, y - 3.0)

    def free_at(gap_m):
        state = grid.state.copy()
        state[:, away < 0.75 + gap_m] = UNKNOWN
        seen = OccupancyGrid(state, grid.seen_range_m, grid.origin_m, grid.resolution_m, 1)
        topdown = topdown_map(TopDownMapper(PlanningConfig(hole_area_m2=0.01), BODY), seen, world.sdf, Pose2(3, 3, 0))
        return state_at(topdown, 3.0 + 0.78, 3.0)

    assert free_at(0.3) == FREE
    assert free_at(0.8) == UNKNOWN


def test_a_place_without_a_floor_is_no_way():
    world = room(4, 3)
    below = np.full((4, *world.occupancy.state.shape[1:]), UNKNOWN, np.int8)
    below[:, 10:40, 50:60] = FREE  # Seen through, down to 0.2 m below the floor.
    state = np.concatenate([below, world.occupancy.state])
    state[4, :, :50] = OCCUPIED
    seen = np.full(state.shape, np.inf, np.float32)
    grid = OccupancyGrid(state, seen, np.array([0.0, 0.0, -0.2]), RESOLUTION_M)
    topdown = topdown_map(TopDownMapper(PlanningConfig(), BODY), grid, world.sdf, Pose2(1, 1, 0))
    assert state_at(topdown, 2.75, 1.0) == OCCUPIED
    assert state_at(topdown, 1.0, 1.5) == FREE
    # A drop is told from a wall.
    assert topdown.no_floor[20, 55]
    assert not topdown.no_floor[20, :50].any()


def test_a_map_kept_up_step_by_step_is_the_map_made_at_once():
    rng = np.random.default_rng(2)
    world = room(14, 9, boxes=[(5, 0.2, 5.2, 6), (9, 3, 9.3, 9.2)])
    whole, state = world.occupancy.state.copy(), world.occupancy.state
    state[:] = UNKNOWN
    changed = np.zeros((47, 72), np.int32)  # Blocks of 4 x 4 columns.
    places = [Pose2(1.5 + 0.3 * i, 1.0 + 0.2 * i, 0.0) for i in range(30)]
    kept = TopDownMapper(PlanningConfig(), BODY)
    for version, pose in enumerate(places, 1):
        # What lies within sight of the robot becomes known, at random.
        row, col = (slice(max(round((c - 4) * 5), 0) * 4, round((c + 4) * 5) * 4) for c in (pose.y_m, pose.x_m))
        known = rng.random(whole[:, row, col].shape) < 0.5
        state[:, row, col][known] = whole[:, row, col][known]
        changed[row.start // 4 : row.stop // 4, col.start // 4 : col.stop // 4] = version
        topdown = topdown_map(kept, replace(world.occupancy, version=version, column_version=changed), world.sdf, pose)
    fresh = TopDownMapper(PlanningConfig(), BODY)
    for pose in places:
        fresh.visit(pose.xy_m)
    at_once = topdown_map(fresh, world.occupancy, world.sdf, places[-1])
    assert np.array_equal(topdown.state, at_once.state)
    assert np.allclose(topdown.clearance_m, at_once.clearance_m, atol=1e-5)


def test_turning_on_the_spot_adds_nothing_to_the_trajectory():
    mapper = TopDownMapper(PlanningConfig(), BODY)
    for place in ([1.0, 1.0], [1.0, 1.0], [1.065, 1.0], [1.065, 1.0]):
        mapper.visit(np.array(place))
    assert len(mapper.trajectory_xy_m) == 2


def test_low_surface_at_the_body_s_underside_is_an_obstacle_once_it_was_seen_from_near():
    # Voxel centres lie at multiples of their edge, as in the mapper's grid: the body begins in the middle of a layer.
    world = room(4, 3)
    old = world.occupancy
    grid = OccupancyGrid(old.state, old.seen_range_m, np.array([0.0, 0.0, -0.025]), RESOLUTION_M)
    grid.state[1, 30:32, 40:42], grid.seen_range_m[1, 30:32, 40:42] = OCCUPIED, 1.0
    grid.state[1, 30:32, 60:62], grid.seen_range_m[1, 30:32, 60:62] = OCCUPIED, 6.0
    topdown = topdown_map(TopDownMapper(PlanningConfig(), BODY), grid, world.sdf, Pose2(1, 1, 0))
    assert state_at(topdown, 2.05, 1.55) == OCCUPIED
    assert state_at(topdown, 3.05, 1.55) == FREE


def test_the_sdf_is_asked_again_inside_the_horizon_and_never_of_obstacles():
    world, config, asked = room(4, 3, boxes=[(2, 1, 2.5, 1.5)]), PlanningConfig(horizon_m=1.5), []
    mapper, shift_m = TopDownMapper(config, BODY), [0.0]

    def sdf(points):
        asked.append(points)
        return world.sdf(points) - np.float32(shift_m[0])

    version = np.ones((17, 22), np.int32)
    grid = replace(world.occupancy, version=1, column_version=version)
    first = topdown_map(mapper, grid, sdf, Pose2(1.5, 1, 0))
    (points,) = asked
    col, row = np.floor(points[:, :2].T / RESOLUTION_M).astype(int)
    assert not (world.occupancy.state[10, row, col] == OCCUPIED).any()
    assert (abs(points[:, :2] - (1.5, 1.0)) <= 0.75 + RESOLUTION_M).all()
    # What the field has learnt since counts, though no depth has changed.
    shift_m[0] = 0.02
    again = topdown_map(mapper, grid, sdf, Pose2(1.5, 1, 0))
    assert np.array_equal(asked[1], points)
    assert not np.array_equal(first.surface_xy_m, again.surface_xy_m)


def test_a_body_may_be_many_voxels_high():
    state = np.full((288, 64, 64), FREE, np.int8)
    state[:, :2] = state[:, -2:] = state[:, :, :2] = state[:, :, -2:] = state[0] = OCCUPIED
    columns = np.ones((4, 4), np.int32)
    origin_m = np.array([0.0, 0.0, -0.0025])
    grid = OccupancyGrid(state, np.ones(state.shape, np.float32), origin_m, 0.005, 1, columns)
    mapper = TopDownMapper(PlanningConfig(horizon_m=100.0, hole_area_m2=1e-6), Footprint(0.02, 0.05, 1.35))
    topdown = topdown_map(mapper, grid, lambda points: np.full(len(points), 0.1, np.float32), Pose2(0.16, 0.16, 0.0))
    assert state_at(topdown, 0.05, 0.25) == FREE


@pytest.mark.parametrize("top_m", [0.09, 1.35])
def test_a_body_of_any_height_has_a_map(top_m):
    world = room(4, 3)
    mapper = TopDownMapper(PlanningConfig(horizon_m=100.0), Footprint(0.18, 0.05, top_m))
    topdown = topdown_map(mapper, world.occupancy, world.sdf, Pose2(2.0, 1.5, 0.0))
    assert (topdown.state == FREE).any()
