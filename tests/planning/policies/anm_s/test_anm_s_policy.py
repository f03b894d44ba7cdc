import math
from dataclasses import replace

import numpy as np

from anm_mj.planning.policies.anm_s.anm_s_config import TARGETS, AnmSConfig
from anm_mj.planning.policies.anm_s.anm_s_policy import AnmS
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.stages import TRY_AGAIN
from anm_mj.types import (
    Action,
    Footprint,
    Intrinsics,
    Observation,
    Pose2,
    StopReason,
    SurfacePoints,
)
from tests.box_room import camera_pose
from tests.planning.worlds import room

BODY = Footprint(0.18, 0.05, 1.35)
WALL = [(4.2, 0.2, 4.3, 1.2), (4.2, 2.1, 4.3, 3.2)]
TABLE = (2.2, 1.2, 2.9, 2.1)


def observation(x, y):
    camera = camera_pose(Pose2(x, y, 0.0))
    return Observation(
        0, 0.0, np.zeros((2, 2, 3), np.uint8), np.ones((2, 2), np.float32), Intrinsics.from_fov(2, 2, 1.57), camera,
        Pose2(x, y, 0.0),
    )  # fmt: skip


def two_rooms():
    """Two rooms, seen from afar only: a table in the first, an uncertain patch on the far wall of the second."""
    world = room(8, 3, boxes=[*WALL, TABLE])
    world.occupancy.seen_range_m[:] = 6.0
    y, z = np.meshgrid(np.arange(1.4, 2.0, 0.1), np.arange(0.4, 1.2, 0.1))
    patch = np.stack([np.full(y.size, 8.2), y.ravel(), z.ravel()], axis=1).astype(np.float32)
    plain = np.array([[x, 0.2, 0.5] for x in np.arange(0.5, 8.0, 0.02)], np.float32)
    normal = np.concatenate([np.tile([-1.0, 0, 0], (len(patch), 1)), np.tile([0, 1.0, 0], (len(plain), 1))])
    values = np.concatenate([np.full(len(patch), 9.0), np.ones(len(plain))])
    surface = SurfacePoints(np.concatenate([patch, plain]), normal.astype(np.float32), values.astype(np.float32))
    world.surface = lambda centre_xy_m, radius_m, max_height_m: surface
    return world


def decide(world, seed=0, **settings):
    settings = {"bootstrap_turns": 0, **settings}
    return AnmS(PolicyContext(BODY, AnmSConfig(**settings), seed=seed)).plan(world, observation(1.0, 1.7))


def test_the_hierarchy_stays_in_the_horizon_and_the_most_uncertain_is_chased_through_the_door():
    world = two_rooms()
    near = decide(world)
    far = decide(world, target="best-anchored")
    assert near.target_xy_m is not None
    assert near.target_xy_m[0] < 4.2
    assert far.target_xy_m is not None
    assert far.target_xy_m[0] > 4.3
    assert [region.vertex for region in far.regions if region.centre_m[0] > 8.0]


def test_the_rest_of_the_room_comes_before_the_next_room_and_that_before_farther_ones():
    # A hall of 12 m; a room behind a door beside the robot, and another one behind that.
    hall = room(12, 7, boxes=[(0.2, 3.2, 1.0, 3.3), (1.9, 3.2, 12.2, 3.3), (5.0, 3.3, 5.1, 4.0), (5.0, 4.9, 5.1, 7.2)])
    hall.occupancy.seen_range_m[:] = 6.0
    places = np.stack(np.meshgrid(np.arange(0.6, 12.2, 0.6), np.arange(0.6, 7.2, 0.6)), axis=-1).reshape(-1, 2)
    in_hall = places[:, 1] < 3.2
    policy = AnmS(PolicyContext(BODY, AnmSConfig(bootstrap_turns=0)))

    def plan_after_visiting(which):
        for place in places[which]:
            policy.stages.topdown.visit(place)
        policy.targets.clear()
        return policy.plan(hall, observation(1.5, 1.7))

    rest = plan_after_visiting(in_hall & (places[:, 0] < 5.0))
    assert "in the rest of the room" in rest.reason
    assert rest.target_xy_m[1] < 3.2
    # The nearest of all would have been behind the door.
    assert min(rest.candidates, key=lambda candidate: candidate.cost_steps).xy_m[1] > 3.2
    following = plan_after_visiting(in_hall)
    assert "in room 1" in following.reason
    assert following.target_xy_m[1] > 3.2
    assert following.target_xy_m[0] < 5.1
    last = plan_after_visiting(places[:, 0] < 5.0)
    assert "in room 2" in last.reason
    assert last.target_xy_m[0] > 5.0


def test_rooms_are_looked_for_where_vertices_are_ordered_by_them_alone():
    world = two_rooms()
    for target in TARGETS:
        policy = AnmS(PolicyContext(BODY, AnmSConfig(target=target)))
        now = policy.stages.read(world, observation(1.0, 1.7))
        assert set(now.room) == ({0, 1} if target == "hierarchical" else {-1})
        assert list(now.watch.ms) == ["topdown", "graph", "paths", "rooms", "regions"]


def test_without_visibility_guidance_the_robot_turns_to_nothing():
    assert decide(two_rooms(), target="best-anchored", visibility_guidance=False).headings_rad == ()


def test_random_targets_depend_on_the_seed_alone():
    world = two_rooms()
    targets = [tuple(decide(world, seed, target="random").path_xy_m[-1]) for seed in (0, 0, 1, 2, 3)]
    assert targets[0] == targets[1]
    assert len(set(targets)) > 1


def test_the_bootstrap_is_one_full_turn_and_can_be_left_out():
    assert len(decide(two_rooms(), bootstrap_turns=36).actions) == 36
    assert decide(two_rooms()).actions == ()


def test_a_place_without_any_way_out_ends_the_run():
    walls = [(0.7, 1.4, 0.8, 2.0), (1.2, 1.4, 1.3, 2.0), (0.7, 1.4, 1.3, 1.5), (0.7, 1.9, 1.3, 2.0)]
    world = room(4, 3, boxes=walls)
    policy = AnmS(PolicyContext(BODY, AnmSConfig(bootstrap_turns=0)))
    assert len(policy.plan(world, observation(1.0, 1.7)).actions) == 36
    end = policy.plan(world, observation(1.0, 1.7))
    assert end.stop is StopReason.NO_REACHABLE_TARGET
    assert end.reason.endswith("parts of the graph out of reach: 1")


def test_a_robot_that_refused_steps_keep_from_most_of_the_graph_is_not_done():
    world = two_rooms()
    world.occupancy.seen_range_m[:] = 2.0
    policy = AnmS(PolicyContext(BODY, AnmSConfig(bootstrap_turns=0)))
    for x in np.arange(0.6, 8.0, 0.5):
        for y in np.arange(0.6, 3.0, 0.5):
            policy.stages.topdown.visit(np.array([x, y]))
    for yaw in np.arange(0.0, 2.0 * math.pi, 0.3):
        policy.on_collision(Pose2(1.0, 1.7, yaw), Action.MOVE_FORWARD)
    assert len(policy.plan(world, observation(1.0, 1.7)).actions) == 36
    assert policy.plan(world, observation(1.0, 1.7)).reason.endswith(TRY_AGAIN)
    assert policy.plan(world, observation(1.0, 1.7)).stop is StopReason.NO_REACHABLE_TARGET


def test_where_there_is_no_room_for_any_graph_the_run_ends_too():
    policy = AnmS(PolicyContext(BODY, AnmSConfig(bootstrap_turns=0)))
    cell = room(0.3, 0.3)
    assert len(policy.plan(cell, observation(0.35, 0.35)).actions) == 36
    assert policy.plan(cell, observation(0.35, 0.35)).stop is StopReason.NO_REACHABLE_TARGET


def test_when_everything_was_visited_the_robot_looks_around_once_and_the_run_ends():
    world = two_rooms()
    world.occupancy.seen_range_m[:] = 2.0
    policy = AnmS(PolicyContext(BODY, AnmSConfig(bootstrap_turns=0)))
    for x in np.arange(0.6, 8.0, 0.5):
        for y in np.arange(0.6, 3.0, 0.5):
            policy.stages.topdown.visit(np.array([x, y]))
    around = policy.plan(world, observation(1.0, 1.7))
    assert len(around.actions) == 36
    end = policy.plan(world, observation(1.0, 1.7))
    assert end.stop is StopReason.COMPLETE
    assert end.reason.endswith("parts of the graph out of reach: 0")


def test_a_door_that_was_passed_and_not_looked_through_is_gone_to_before_the_run_ends():
    world = room(8, 3, boxes=WALL, unknown=[(4.3, 0.2, 8.2, 3.2)])
    policy = AnmS(PolicyContext(BODY, AnmSConfig(bootstrap_turns=0)))
    for x in np.arange(0.6, 3.6, 0.5):
        for y in np.arange(0.6, 3.0, 0.5):
            policy.stages.topdown.visit(np.array([x, y]))

    plan = policy.plan(world, observation(1.0, 1.7))

    assert plan.reason.startswith("every vertex is visited: a look into the unknown")
    assert plan.target_xy_m is not None
    assert 2.5 < plan.target_xy_m[0] < 4.3
    assert len(plan.headings_rad) == 1
    assert abs(plan.headings_rad[0]) < math.radians(45)


def test_vertices_whose_surroundings_were_seen_from_elsewhere_come_last():
    world = two_rooms()
    world.occupancy.seen_range_m[:, :, : round(4.8 / world.occupancy.resolution_m)] = 2.0
    assert decide(world, visited_by="place").target_xy_m[0] < 4.2
    assert decide(world).target_xy_m[0] > 4.2
    world.occupancy.seen_range_m[:] = 2.0
    assert decide(world).target_xy_m is not None


def test_by_place_only_where_the_robot_was_is_visited():
    world = two_rooms()
    world.occupancy.seen_range_m[:] = 2.0
    plan = decide(world, visited_by="place")
    assert plan.target_xy_m is not None
    assert math.dist(plan.target_xy_m, (1.0, 1.7)) > AnmSConfig().visited_radius_m


def test_a_target_is_kept_until_it_has_been_reached():
    world = two_rooms()
    policy = AnmS(PolicyContext(BODY, AnmSConfig(bootstrap_turns=0, target="best-anchored")))
    far = policy.plan(world, observation(1.0, 1.7)).target_xy_m
    policy.config = replace(policy.config, target="hierarchical")
    again = policy.plan(world, observation(1.6, 1.7)).target_xy_m
    assert far is not None
    assert again is not None
    assert np.allclose(far, again)


def test_a_target_that_the_robot_turns_from_three_times_is_given_up():
    policy = AnmS(PolicyContext(BODY, AnmSConfig(bootstrap_turns=0, target="best-anchored")))
    first = policy.plan(two_rooms(), observation(1.0, 1.7)).target_xy_m
    for _ in range(3):
        policy.targets.choose(first, (), unvisited=True)
        policy.targets.drop_for(first + 2.0, Pose2(1.0, 1.7, 0.0))
    policy.targets.clear()

    again = policy.plan(two_rooms(), observation(1.0, 1.7)).target_xy_m

    assert again is not None
    assert math.dist(again, first) >= 0.3


def test_a_target_that_was_blocked_comes_last_and_is_given_up_at_the_second_time():
    world = two_rooms()
    policy = AnmS(PolicyContext(BODY, AnmSConfig(bootstrap_turns=0, target="best-anchored")))
    targets = []
    while (target := policy.plan(world, observation(1.0, 1.7)).target_xy_m) is not None:
        targets.append(tuple(target.tolist()))
        policy.on_collision(Pose2(1.0, 1.7, 0.0), Action.TURN_LEFT)
    assert targets[0] != targets[1]
    assert all(targets.count(target) == 2 for target in targets)


def test_a_region_is_looked_at_once():
    world = two_rooms()
    policy = AnmS(PolicyContext(BODY, AnmSConfig(bootstrap_turns=0, target="best-anchored")))
    plan = policy.plan(world, observation(1.0, 1.7))
    assert len(plan.headings_rad) == 1 or len(plan.regions) == 1
    x, y = plan.path_xy_m[-1].tolist()
    policy.observe(observation(x, y))
    after = policy.plan(world, observation(x, y))
    assert len(after.regions) < len(plan.regions)


def test_before_the_end_the_robot_looks_into_a_narrow_passage_and_squeezes_through():
    # 0.4 m wide: the body of 0.36 m fits, but not with its margin on both sides.
    world = room(8, 3, boxes=[(4.2, 0.2, 4.3, 1.5), (4.2, 1.9, 4.3, 3.2)])
    policy = AnmS(PolicyContext(BODY, AnmSConfig(bootstrap_turns=0, visited_by="place")))
    for x, y in np.stack(np.meshgrid(np.arange(0.6, 3.8, 0.4), np.arange(0.6, 3.0, 0.4)), axis=-1).reshape(-1, 2):
        policy.stages.topdown.visit(np.array([x, y]))
    look = policy.plan(world, observation(1.0, 1.7))
    assert "narrow passage" in look.reason
    assert look.target_xy_m is not None
    assert look.target_xy_m[0] < 4.2
    # It faces the passage there.
    towards = np.array([4.25, 1.7]) - look.target_xy_m
    assert abs(math.remainder(look.headings_rad[0] - math.atan2(towards[1], towards[0]), math.tau)) < 0.6
    plans = []
    for _ in range(16):
        policy.stages.topdown.visit(look.target_xy_m)
        plans.append(policy.plan(world, observation(*look.target_xy_m)))
        if plans[-1].target_xy_m is not None and plans[-1].target_xy_m[0] > 4.3:
            break
        look = plans[-1] if plans[-1].target_xy_m is not None else look
    assert plans[-1].target_xy_m is not None
    assert plans[-1].target_xy_m[0] > 4.3
    assert any(TRY_AGAIN in plan.reason for plan in plans)


def test_a_passage_that_no_body_fits_through_stays_shut():
    world = room(8, 3, boxes=[(4.2, 0.2, 4.3, 1.6), (4.2, 1.8, 4.3, 3.2)])
    policy = AnmS(PolicyContext(BODY, AnmSConfig(bootstrap_turns=0, visited_by="place")))
    for x, y in np.stack(np.meshgrid(np.arange(0.4, 4.2, 0.2), np.arange(0.4, 3.2, 0.2)), axis=-1).reshape(-1, 2):
        policy.stages.topdown.visit(np.array([x, y]))
    plans = [policy.plan(world, observation(1.0, 1.7)) for _ in range(12)]
    assert plans[-1].stop is StopReason.COMPLETE
