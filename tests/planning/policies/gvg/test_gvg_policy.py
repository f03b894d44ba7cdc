import re
from dataclasses import replace

import numpy as np
import pytest

from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.guarded_policy import plan_fault
from anm_mj.planning.policies.gvg.gvg_config import GvgConfig
from anm_mj.planning.policies.gvg.gvg_policy import Gvg
from anm_mj.planning.stages import TRY_AGAIN
from anm_mj.types import Action, Footprint, Intrinsics, Observation, Pose2, StopReason, SurfaceErrors
from tests.box_room import CAMERA, camera_pose, room_depth
from tests.planning.worlds import room

START = Pose2(1.5, 2.0, 2.0)


def observation(pose: Pose2, step: int = 0, aside_rad: float = 0.0) -> Observation:
    """The view of a camera that looks aside to the left."""
    T_world_camera = camera_pose(replace(pose, yaw_rad=pose.yaw_rad + aside_rad))
    rgb = np.zeros((256, 256, 3), np.uint8)
    return Observation(step, 0.0, rgb, room_depth(T_world_camera), CAMERA, T_world_camera, pose)


def half_known_room():
    return room(8, 4, unknown=[(5.2, 0.2, 8.2, 4.2)])


def policy(**settings):
    return Gvg(PolicyContext(Footprint(0.18, 0.05, 1.35), GvgConfig(**{"bootstrap_turns": 0} | settings)))


def test_begins_with_a_rotation():
    first = policy(bootstrap_turns=5).plan(half_known_room(), observation(START))
    assert first.actions == (Action.TURN_LEFT,) * 5


def test_looks_towards_the_unknown():
    plan = policy().plan(half_known_room(), observation(START))
    end = plan.path_xy_m[-1] if len(plan.path_xy_m) else START.xy_m
    assert end[0] + 4.5 * np.cos(plan.headings_rad[-1]) > 5.2
    assert plan.reason.startswith("target chosen: expected gain ")


@pytest.mark.parametrize("aside_deg", [-30.0, 0.0, 30.0])
def test_a_robot_turns_its_camera_to_the_unknown_and_not_its_base(aside_deg: float):
    world = room(4, 3, unknown=[(3.2, 1.5, 4.2, 1.9)])
    world.occupancy.state[:2] = world.occupancy.state[-2:] = 1
    here = observation(Pose2(1.0, 1.7, np.pi), aside_rad=np.radians(aside_deg))
    plan = policy().plan(world, replace(here, intrinsics=Intrinsics.from_fov(256, 256, np.radians(40.0))))
    end = plan.path_xy_m[-1] if len(plan.path_xy_m) else here.pose.xy_m
    towards = np.array([3.7, 1.7]) - end
    off_axis = plan.headings_rad[-1] + np.radians(aside_deg) - np.arctan2(towards[1], towards[0])
    assert np.cos(off_axis) > np.cos(np.radians(20.0))


def test_known_room_is_complete():
    world = room(4, 3)
    world.occupancy.state[:2] = world.occupancy.state[-2:] = 1
    assert policy().plan(world, observation(Pose2(1.5, 1.5, 0.0))).stop is StopReason.COMPLETE


def test_plan_is_reused_while_nothing_new_is_seen():
    world, gvg = half_known_room(), policy()
    first, second = gvg.plan(world, observation(START)), gvg.plan(world, observation(START, 1))
    assert second.reason.startswith("plan reused: ")
    assert second.headings_rad == first.headings_rad


def test_a_target_that_is_reached_is_compared_with_what_was_expected_of_it():
    world, gvg = half_known_room(), policy()
    chosen = gvg.plan(world, observation(START))
    (gain_m2,) = re.findall(r"expected gain ([0-9.]+) m²", chosen.reason)
    end = chosen.path_xy_m[-1] if len(chosen.path_xy_m) else START.xy_m
    closed = gvg.plan(world, observation(Pose2(*end, chosen.headings_rad[-1]), 1)).closed
    assert closed is not None
    assert closed.promised_m2 == pytest.approx(float(gain_m2), abs=0.051)
    # The map stayed as it was: nothing was seen, but all of the view was looked at.
    assert 1.0 < closed.expected_m2 <= closed.promised_m2
    assert closed.realised_m2 == 0.0


def test_plan_is_dropped_after_a_collision():
    world, gvg = half_known_room(), policy()
    gvg.plan(world, observation(START))
    gvg.on_collision(START, Action.MOVE_FORWARD)
    assert gvg.plan(world, observation(START, 1)).reason.startswith("target chosen: ")


def plan_without_news(stagnation_gain_m2, min_stagnation_steps):
    """The decision after 100 steps at one place that showed nothing new."""
    settings = {"stagnation_gain_m2": stagnation_gain_m2, "min_stagnation_steps": min_stagnation_steps}
    world, gvg = half_known_room(), policy(max_plan_reuse=1, **settings)
    return [gvg.plan(world, observation(START, step)) for step in (0, 50, 100)][-1]


def test_residual_gain_is_left_during_stagnation():
    plan = plan_without_news(1000.0, 50)
    assert plan.stop is StopReason.COMPLETE
    assert plan.reason.startswith("stagnation: next to no new surface in the last 10% of the steps")


def test_stagnation_does_not_end_a_tour_with_enough_gain():
    assert plan_without_news(0.01, 50).stop is None


def test_residual_gain_is_taken_before_stagnation():
    assert plan_without_news(1000.0, 500).stop is None


def badly_known_room(error_m=0.04, **given):
    """A room that was seen as a whole but for what is ``given``, with surface of which one part is known badly."""
    world = room(4, 3, **given)
    world.occupancy.state[:1] = world.occupancy.state[-2:] = 1

    def surface_errors(centre_xy_m, radius_m):
        y, z = np.meshgrid(np.arange(0.2, 3.2, 0.1), np.arange(0.1, 2.5, 0.1))
        xyz = np.stack([np.full(y.size, 4.22), y.ravel(), z.ravel()], axis=1).astype(np.float32)
        return SurfaceErrors(xyz, np.full(len(xyz), error_m, np.float32), np.full(len(xyz), 3.0, np.float32), 0.3)

    world.surface_errors = surface_errors
    return world


def with_goal(goal):
    return Gvg(PolicyContext(Footprint(0.18, 0.05, 1.35), GvgConfig(bootstrap_turns=0), goal=goal))


def test_when_all_is_seen_the_robot_looks_at_what_is_known_badly():
    here = observation(Pose2(1.5, 1.5, np.pi))
    assert with_goal("coverage").plan(badly_known_room(), here).stop is StopReason.COMPLETE
    for goal in ("both", "reconstruction"):
        plan = with_goal(goal).plan(badly_known_room(), here)
        assert plan.stop is None
        assert plan.reason.startswith("target chosen to improve the map: ")
        end = plan.path_xy_m[-1] if len(plan.path_xy_m) else here.pose.xy_m
        towards = np.array([4.2, 1.7]) - end
        off_axis = plan.headings_rad[-1] - np.arctan2(towards[1], towards[0])
        assert np.cos(off_axis) > np.cos(np.radians(50.0))


def test_a_run_is_complete_when_improvement_is_not_worth_a_step():
    plan = with_goal("both").plan(badly_known_room(error_m=0.0005), observation(Pose2(1.5, 1.5, np.pi)))
    assert plan.stop is StopReason.COMPLETE
    assert "with improvement" in plan.reason


def visited_targets(gvg, world, num, pose=Pose2(1.5, 1.5, np.pi)):  # noqa: B008
    """A policy after it went to some targets in a row, none of which changed the map, and what each one brought."""
    closed = []
    for step in range(0, 50 * num, 50):
        plan = gvg.plan(world, observation(pose, step))
        closed.append(plan.closed)
        end = plan.path_xy_m[-1] if len(plan.path_xy_m) else pose.xy_m
        pose = Pose2(*end, plan.headings_rad[-1])
    return [outcome for outcome in closed if outcome is not None]


def test_improvement_costs_a_run_that_goes_on_neither_patience_nor_window():
    gvg, world = with_goal("both"), badly_known_room()
    visited_targets(gvg, world, 1)
    before = gvg.memory()
    closed = visited_targets(gvg, world, 6)
    assert len(closed) >= GvgConfig().patience_targets
    assert not any(outcome.realised_m2 for outcome in closed)
    after = gvg.memory()
    assert after["num_poor"] == before["num_poor"] == 0
    np.testing.assert_array_equal(after["window"], before["window"])


def test_a_run_for_the_quality_of_the_map_holds_new_surface_against_new_surface():
    gvg = with_goal("reconstruction")
    plan = gvg.plan(badly_known_room(unknown=[(3.6, 2.4, 4.2, 3.2)]), observation(Pose2(1.5, 1.5, 0.0)))
    (gain_m2,) = re.findall(r"expected gain ([0-9.]+) m²", plan.reason)
    target = gvg._target
    assert target is not None
    # The rest is what the view improves.
    assert 0.0 < target.expected_gain_m2 < float(gain_m2) - 0.1
    assert target.expected_gain_m2 == pytest.approx(target.promised_m2)


@pytest.mark.parametrize("goal", ["both", "coverage", "reconstruction"])
def test_a_robot_that_is_shut_in_has_no_reachable_target(goal):
    walls = [(1.2, 1.2, 1.8, 1.25), (1.2, 1.75, 1.8, 1.8), (1.2, 1.2, 1.25, 1.8), (1.75, 1.2, 1.8, 1.8)]
    plan = with_goal(goal).plan(badly_known_room(0.0005, boxes=walls), observation(Pose2(1.5, 1.5, 0.0)))
    assert plan.stop is StopReason.NO_REACHABLE_TARGET
    assert plan.reason.startswith("no path leads to any of ")


@pytest.mark.parametrize("goal", ["both", "coverage"])
def test_a_robot_that_collisions_cut_off_has_no_reachable_target(goal):
    gvg = with_goal(goal)
    world = badly_known_room(0.0005, boxes=[(1.6, 0.2, 1.7, 1.5), (1.6, 2.1, 1.7, 3.2)])
    for y_m in (1.7, 1.9):
        gvg.on_collision(Pose2(1.4, y_m, 0.0), Action.MOVE_FORWARD)
    plans = [gvg.plan(world, observation(Pose2(0.9, 1.8, 0.0), step)) for step in (0, 1)]
    assert plans[0].reason == TRY_AGAIN
    assert plans[1].stop is StopReason.NO_REACHABLE_TARGET
    assert plans[1].reason.endswith(" vertices since a collision")


def plans_before_a_passage(low_m, high_m):
    """Decisions in a known room with a passage between two heights of its wall; a dark hall lies round the corner."""
    boxes = [(4.2, 0.2, 4.3, low_m), (4.2, high_m, 4.3, 4.2), (5.2, 0.2, 5.3, 3.4)]
    world = room(8, 4, boxes=boxes, unknown=[(5.3, 0.2, 8.2, 4.2)])
    gvg = policy(min_gain_m2=0.6, large_gain_m2=0.6)
    return [gvg.plan(world, observation(Pose2(1.5, 2.0, 0.0), step)) for step in (0, 1)]


def test_a_passage_without_room_for_a_margin_is_tried_before_the_end():
    first, second = plans_before_a_passage(0.6, 0.95)
    assert first.reason == TRY_AGAIN
    # It is too narrow for the body as well.
    assert second.stop is StopReason.COMPLETE


def plans_of(radius_m, low_m, high_m, num=4, start=Pose2(3.0, 1.6, np.pi), aside_rad=0.0, **settings):  # noqa: B008
    """Decisions before a passage to a dark hall, in a room of which a corner is dark as well."""
    boxes = [(4.2, 0.2, 4.3, low_m), (4.2, high_m, 4.3, 4.2)]
    world = room(8, 4, boxes=boxes, unknown=[(5.8, 0.2, 8.2, 4.2), (0.2, 3.4, 1.0, 4.2)])
    context = PolicyContext(Footprint(radius_m, 0.05, 1.35), GvgConfig(bootstrap_turns=0, **settings))
    gvg, pose, plans = Gvg(context), start, []
    for step in range(num):
        plans.append(gvg.plan(world, observation(pose, step, aside_rad)))
        if len(plans[-1].path_xy_m):
            pose = Pose2(*plans[-1].path_xy_m[-1], plans[-1].headings_rad[-1])
    return plans


def test_a_wide_robot_keeps_no_margin_where_much_lies_behind_a_door():
    # 0.6 m: room for the body of 0.54 m, not for its margins.
    plans = plans_of(0.27, 1.3, 1.9)
    assert not any("passage" in plan.reason for plan in plans)
    assert any(plan.path_xy_m[-1][0] > 4.3 for plan in plans if len(plan.path_xy_m))


def test_a_wide_robot_looks_at_a_door_that_seems_too_narrow_twice():
    plans = plans_of(0.27, 1.4, 1.85)
    assert [plan.reason.startswith("a look through the narrow passage") for plan in plans] == [1, 0, 0, 0]
    assert [plan.reason.startswith("a look beside the narrow passage") for plan in plans] == [0, 1, 0, 0]
    towards = np.array([4.25, 1.62]) - plans[0].path_xy_m[-1]
    assert abs(np.arctan2(towards[1], towards[0]) - plans[0].headings_rad[0]) < 0.6


def test_a_camera_that_looks_aside_is_turned_to_a_door():
    look = plans_of(0.27, 1.4, 1.85, num=1, aside_rad=np.radians(30.0))[0]
    assert look.reason.startswith("a look through the narrow passage")
    towards = np.array([4.25, 1.62]) - look.path_xy_m[-1]
    assert abs(np.arctan2(towards[1], towards[0]) - look.headings_rad[0] - np.radians(30.0)) < 0.3


def test_a_robot_that_looks_through_a_narrow_door_already_looks_beside_it():
    # Right before the passage, where another target has led it.
    there = Pose2(3.625, 1.6, 0.0)
    plan = plans_of(0.27, 1.4, 1.85, num=1, start=there)[0]
    assert plan.reason.startswith("a look beside the narrow passage")
    assert plan_fault(plan, there) is None


def test_what_lies_behind_a_door_has_its_price():
    assert not any("passage" in plan.reason for plan in plans_of(0.27, 1.4, 1.85, door_share=100.0))


def test_doors_are_wide_enough_for_other_robots():
    assert not any("passage" in plan.reason for plan in plans_of(0.18, 1.4, 1.7))
