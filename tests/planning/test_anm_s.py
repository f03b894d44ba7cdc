from dataclasses import replace

import numpy as np
import pytest

from anm_mj.errors import PlanError
from anm_mj.planning.config import PlanningConfig
from anm_mj.planning.policies.anm_s import AnmS
from anm_mj.types import Footprint, Intrinsics, Observation, Pose2, StopReason, SurfacePoints
from tests.planning.worlds import room

BODY = Footprint(0.18, 0.05, 1.35)
WALL = [(4.2, 0.2, 4.3, 1.2), (4.2, 2.1, 4.3, 3.2)]


def observation(x, y):
    camera = np.eye(4)
    camera[:3, 3] = x, y, 1.25
    return Observation(
        0, 0.0, np.zeros((2, 2, 3), np.uint8), np.ones((2, 2), np.float32), Intrinsics.from_fov(2, 2, 1.57), camera,
        Pose2(x, y, 0.0),
    )  # fmt: skip


def two_rooms():
    """Two rooms with an uncertain patch on the far wall of the second."""
    world = room(8, 3, boxes=WALL)
    y, z = np.meshgrid(np.arange(1.4, 2.0, 0.1), np.arange(0.4, 1.2, 0.1))
    patch = np.stack([np.full(y.size, 8.2), y.ravel(), z.ravel()], axis=1).astype(np.float32)
    plain = np.array([[x, 0.2, 0.5] for x in np.arange(0.5, 8.0, 0.02)], np.float32)
    normal = np.concatenate([np.tile([-1.0, 0, 0], (len(patch), 1)), np.tile([0, 1.0, 0], (len(plain), 1))])
    values = np.concatenate([np.full(len(patch), 9.0), np.ones(len(plain))])
    surface = SurfacePoints(np.concatenate([patch, plain]), normal.astype(np.float32), values.astype(np.float32))
    world.surface = lambda centre_xy_m, radius_m: surface
    return world


def decide(world, seed=0, **settings):
    settings = {"bootstrap_turns": 0, **settings}
    return AnmS(replace(PlanningConfig(), **settings), BODY, seed).plan(world, observation(1.0, 1.7))


def test_the_hierarchy_stays_in_the_horizon_and_the_most_uncertain_is_chased_through_the_door():
    world = two_rooms()
    near = decide(world)
    far = decide(world, target="best-anchored")
    assert near.target_xy_m is not None
    assert near.target_xy_m[0] < 4.2
    assert far.target_xy_m is not None
    assert far.target_xy_m[0] > 4.3
    assert len(far.headings_rad) == 1
    assert abs(far.headings_rad[0]) < 1.6


def test_without_visibility_guidance_the_robot_turns_to_nothing():
    assert decide(two_rooms(), target="best-anchored", visibility_guidance=False).headings_rad == ()


def test_random_targets_depend_on_the_seed_alone():
    world = two_rooms()
    targets = [tuple(decide(world, seed, target="random").path_xy_m[-1]) for seed in (0, 0, 1, 2, 3)]
    assert targets[0] == targets[1]
    assert len(set(targets)) > 2


def test_the_bootstrap_is_one_full_turn_and_can_be_left_out():
    assert len(decide(two_rooms(), bootstrap_turns=36).actions) == 36
    assert decide(two_rooms()).actions == ()


def test_a_place_without_any_way_out_ends_the_run():
    world = room(4, 3, boxes=[(0.2, 1.2, 4.2, 1.3)])
    policy = AnmS(replace(PlanningConfig(), bootstrap_turns=0), BODY, 0)
    for _ in range(3):
        plan = policy.plan(world, observation(0.4, 0.4))
        if plan.stop is not None:
            break
    assert plan.stop in (None, StopReason.NO_REACHABLE_TARGET)


def test_an_unknown_way_to_choose_is_refused():
    with pytest.raises(PlanError, match="hierarchical"):
        PlanningConfig(target="nearest")
