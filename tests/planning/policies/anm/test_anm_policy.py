import copy
import math

import numpy as np
import pytest

from anm_mj.control.path_follower import Follower
from anm_mj.errors import PlanError
from anm_mj.planning.policies.anm.anm_policy import Anm, AnmConfig, _cut_end
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.types import Action, Footprint, Pose2, StopReason, SurfacePoints
from tests.planning.policies.frontier.test_frontier_policy import look
from tests.planning.worlds import BoxWorld

FOOTPRINT = Footprint(0.18, 0.05, 1.35)


class Uncertain(BoxWorld):
    """Two walls of the box room with points on them, the one at +x more uncertain than the one at -x."""

    def __init__(self, *, high: float, low: float):
        super().__init__((1.0, 1.0), [])
        y, z = (g.ravel() for g in np.meshgrid(np.linspace(-0.5, 0.5, 11), np.linspace(0.3, 1.2, 10)))
        sides = [np.stack([np.full(y.size, x), y, z], axis=1) for x in (2.0, -2.0)]
        calm = np.stack([np.linspace(-1.9, 1.9, 4000), np.full(4000, 1.5), np.full(4000, 0.5)], axis=1)
        self.points = SurfacePoints(
            np.concatenate([*sides, calm]).astype(np.float32),
            np.repeat(np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0]], np.float32), [y.size, y.size, 4000], axis=0),
            np.repeat(np.array([high, low, 0.1], np.float32), [y.size, y.size, 4000]),
        )

    def surface(self, centre_xy_m, radius_m, max_height_m=np.inf):
        return self.points


@pytest.fixture(scope="module")
def looked_around() -> Anm:
    policy = Anm(PolicyContext(FOOTPRINT, AnmConfig()))
    for k in range(36):
        policy.observe(look(Pose2(0.0, 0.0, math.radians(10 * k))))
    return policy


@pytest.fixture
def policy(looked_around) -> Anm:
    return copy.deepcopy(looked_around)


@pytest.mark.parametrize(("high", "low", "side"), [(9.0, 8.0, 1.0), (8.0, 9.0, -1.0)])
def test_the_cluster_of_highest_variance_is_driven_to(policy, high, low, side):
    plan = policy.plan(Uncertain(high=high, low=low), look(Pose2(0.0, 0.0, 0.0)))

    best = max(plan.candidates, key=lambda c: c.score)
    np.testing.assert_allclose(best.xy_m, [side * 1.5, 0.0], atol=0.05)
    assert math.dist(plan.path_xy_m[-1], best.xy_m) == pytest.approx(0.8, abs=0.05)
    assert math.cos(plan.headings_rad[0]) == pytest.approx(side, abs=0.01)
    assert plan.valid_steps == 100


def test_a_target_that_the_robot_has_all_but_come_to_is_left_out(policy):
    # 0.85 m before the target of the wall at +x, looking at it: of that way nothing would be left.
    plan = policy.plan(Uncertain(high=9.0, low=8.0), look(Pose2(0.65, 0.0, 0.0)))

    assert max(c.xy_m[0] for c in plan.candidates) < 1.0
    assert len(plan.path_xy_m) > 1


@pytest.mark.parametrize("distance_m", np.arange(0.8, 1.0, 0.0125).tolist())
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_every_plan_asks_for_something_whatever_the_distance_to_its_target(policy, side, distance_m):
    # The path ends in the middle of the target's cell, so that it may be half a cell shorter than the distance.
    here = Pose2(side * (1.5 - distance_m), 0.0, 0.0 if side > 0 else math.pi)
    world = Uncertain(high=9.0, low=9.0)
    wall = world.points.xyz_m[:, 0] == side * 2.0
    world.points = SurfacePoints(world.points.xyz_m[wall], world.points.normal[wall], world.points.uncertainty[wall])

    plan = policy.plan(world, look(here))

    follower = Follower()
    follower.start(plan)
    assert follower.next_action(here) is not None


def test_with_nothing_to_go_to_it_looks_around_once_and_then_stops(policy):
    world, here = BoxWorld((1.0, 1.0), []), look(Pose2(0.0, 0.0, 0.0))

    first, second = policy.plan(world, here), policy.plan(world, here)

    assert first.actions == (Action.TURN_LEFT,) * 36
    assert second.stop is StopReason.NO_REACHABLE_TARGET


def test_where_no_target_of_the_most_uncertain_tenth_can_be_reached_the_next_tenth_has_some(policy):
    world = Uncertain(high=9.0, low=8.0)
    points = world.points
    # Behind the wall at +x, where nobody gets, and more of it than a tenth.
    behind = np.stack([np.full(900, 4.0), np.linspace(-1.0, 1.0, 900), np.full(900, 0.5)], axis=1)
    world.points = SurfacePoints(
        np.concatenate([points.xyz_m, behind]).astype(np.float32),
        np.concatenate([points.normal, np.tile(np.array([[1, 0, 0]], np.float32), (900, 1))]),
        np.concatenate([points.uncertainty, np.full(900, 20.0, np.float32)]),
    )

    plan = policy.plan(world, look(Pose2(0.0, 0.0, 0.0)))

    assert plan.stop is None
    assert not plan.actions
    assert plan.reason.startswith("highest variance of ")
    assert "less uncertain than 10 % of the surface" in plan.reason
    # The walls come next, and of them the more uncertain one.
    np.testing.assert_allclose(max(plan.candidates, key=lambda c: c.score).xy_m, [1.5, 0.0], atol=0.05)


def test_a_way_is_cut_across_its_legs():
    way = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.5]])

    np.testing.assert_allclose(_cut_end(way, 0.8), [[0.0, 0.0], [0.7, 0.0]])
    np.testing.assert_allclose(_cut_end(way, 9.0), [[0.0, 0.0]])


def test_the_surface_is_divided_into_few_enough_shares_to_look_through_all():
    with pytest.raises(PlanError, match=r"percentile is 99\.99.*at most 99\.9"):
        AnmConfig(percentile=99.99)
