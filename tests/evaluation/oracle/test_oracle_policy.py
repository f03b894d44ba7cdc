import numpy as np
import pytest

from anm_mj.control.path_follower import Follower
from anm_mj.errors import PlanError
from anm_mj.evaluation.completion import Coverage
from anm_mj.evaluation.oracle.oracle_policy import Oracle, OracleConfig
from anm_mj.evaluation.oracle.tour_annealing import TourAnnealer
from anm_mj.evaluation.oracle.tour_planner import TourPlanner
from anm_mj.evaluation.scene_truth import SceneTruth
from anm_mj.ground_truth.ground_truth import COVERED_M, GroundTruth
from anm_mj.ground_truth.reduced_depth import reduce_depth
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.types import Action, Footprint, MapUpdate, OccupancyGrid, Pose2, StopReason, SurfacePoints
from tests.evaluation.oracle.ray_robot import RayRobot
from tests.ground_truth.test_observable import CAMERA_ON_BASE

ROUNDS = 40
"""Annealing rounds."""
BUDGET = 1500
"""Steps of the runs."""
START = Pose2(-1.5, 0.0, 0.0)


class NoMap:
    """Knows nothing and blocks nothing."""

    truncation_m = 0.1
    occupancy = OccupancyGrid(np.zeros((1, 1, 1), np.int8), np.full((1, 1, 1), np.inf, np.float32), np.zeros(3), 10.0)

    def integrate(self, observation):
        return MapUpdate(0.0, 0, 0)

    def sdf(self, points_m):
        return np.ones(len(points_m), np.float32)

    def uncertainty(self, points_m):
        return np.ones(len(points_m), np.float32)

    def occupancy_grid(self, centre_xy_m=None, radius_m=np.inf):
        return self.occupancy

    def surface(self, centre_xy_m, radius_m, max_height_m=np.inf):
        nothing = np.zeros((0, 3), np.float32)
        return SurfacePoints(nothing, nothing, np.zeros(0, np.float32))


def oracle_for(truth, area):
    context = PolicyContext(
        Footprint(0.18, 0.05, 1.35), OracleConfig(rounds=ROUNDS), truth=SceneTruth(truth, area, CAMERA_ON_BASE, BUDGET)
    )
    return Oracle(context)


def test_the_oracle_sees_nearly_all(rooms):
    truth, area = rooms
    robot = RayRobot(truth, area, Pose2(-1.5, 0.0, 0.0))
    oracle, follower = oracle_for(truth, area), Follower()
    coverage = Coverage(truth.samples[truth.observable])
    plan, collisions = None, 0

    for _ in range(1500):
        seen = robot.observe()
        oracle.observe(seen)
        coverage.add(reduce_depth(seen.depth_m), seen.intrinsics, seen.T_world_camera)
        action = follower.next_action(seen.pose)
        if action is None:
            plan = oracle.plan(NoMap(), seen)
            if plan.stop is not None:
                break
            follower.start(plan)
            action = follower.next_action(seen.pose)
        assert action is not None
        collided = robot.act(action).collided
        collisions += collided
        if collided:
            oracle.on_collision(seen.pose, action)
            follower.drop()

    assert plan is not None
    assert plan.stop is StopReason.COMPLETE
    assert (coverage.distance_m < COVERED_M).mean() > 0.99
    assert collisions <= 1  # Residual samples are visible from the very edge of the area only.


def first_plan(rooms):
    truth, area = rooms
    oracle = oracle_for(truth, area)
    seen = RayRobot(truth, area, Pose2(-1.5, 0.0, 0.0)).observe()
    oracle.observe(seen)
    return oracle.plan(NoMap(), seen)


def test_a_cached_tour_is_not_searched_again(rooms, monkeypatch):
    plan = first_plan(rooms)
    monkeypatch.setattr(TourAnnealer, "anneal", lambda *_: pytest.fail("searched again"))

    assert first_plan(rooms).actions == plan.actions


@pytest.mark.slow
def test_a_damaged_tour_in_the_cache_is_searched_again(rooms, tmp_path):
    plan = first_plan(rooms)
    (kept,) = (tmp_path / "cache").rglob("*.json")
    kept.write_text("[[1, 2")

    assert first_plan(rooms).actions == plan.actions


def test_a_stop_is_retried_after_a_collision(rooms):
    truth, area = rooms
    oracle = oracle_for(truth, area)
    seen = RayRobot(truth, area, Pose2(-1.5, 0.0, 0.0)).observe()
    oracle.observe(seen)
    first = oracle.plan(NoMap(), seen)

    oracle.on_collision(seen.pose, Action.MOVE_FORWARD)

    assert oracle.plan(NoMap(), seen).reason == first.reason


def test_a_turn_that_touches_something_closes_no_spot_ahead(rooms, monkeypatch):
    truth, area = rooms
    oracle = oracle_for(truth, area)
    oracle.observe(RayRobot(truth, area, Pose2(-1.5, 0.0, 0.0)).observe())
    avoided = []
    monkeypatch.setattr(oracle._planner, "avoid", avoided.append)
    oracle.on_collision(Pose2(-1.5, 0.0, 0.0), Action.TURN_LEFT)
    assert not avoided
    oracle.on_collision(Pose2(-1.5, 0.0, 0.0), Action.MOVE_FORWARD)
    assert len(avoided) == 1


def test_without_the_observable_surface_there_is_no_oracle(rooms):
    truth, area = rooms
    with pytest.raises(PlanError, match="embree"):
        oracle_for(GroundTruth(truth.samples, truth.vertices, truth.faces), area)
    nothing = np.zeros(len(truth.samples), bool)
    with pytest.raises(PlanError, match="no surface that the camera covers within 10 m"):
        oracle_for(GroundTruth(truth.samples, truth.vertices, truth.faces, nothing), area)


@pytest.fixture
def planner(rooms):
    truth, area = rooms
    return TourPlanner(SceneTruth(truth, area, CAMERA_ON_BASE, BUDGET), ROUNDS, START)


def test_no_tour_is_planned_if_nothing_is_left(planner):
    assert planner.next_tour(START, np.zeros(len(planner.samples), bool), BUDGET) == []


def test_samples_that_stay_uncovered_are_given_up(planner):
    left = np.zeros(len(planner.samples), bool)
    left[:40] = True

    tours = [planner.next_tour(START, left, BUDGET) for _ in range(4)]

    assert tours[1]
    assert tours[-1] == []
