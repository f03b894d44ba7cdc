import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anm_mj.errors import PlanError
from anm_mj.evaluation.oracle.discretize import shorter_side
from anm_mj.evaluation.oracle.segments import NO_YAW, Segments
from anm_mj.evaluation.oracle.tour_annealing import MEASURES, Measure, Task, TourAnnealer
from anm_mj.evaluation.oracle.tour_planner import TourPlanner
from anm_mj.evaluation.oracle.upper_bound import coverage_bound, earliest_steps
from anm_mj.evaluation.oracle.visibility import count
from anm_mj.evaluation.oracle.warm_start import read_trajectories, stops_along
from anm_mj.evaluation.scene_truth import SceneTruth
from anm_mj.types import FORWARD_STEP_M, TURN_STEP_RAD, Pose2
from tests.ground_truth.test_observable import CAMERA_ON_BASE

SPACING_M = 0.4
BUDGET = 150


@pytest.fixture(scope="module")
def bounded(rooms, views):
    """A start, the tours from it, and the bound on all of them."""
    _, area = rooms
    roadmap, samples, bits = views
    earliest = earliest_steps(area, roadmap.places_m, roadmap.places_m[3], 0, SPACING_M)
    return roadmap, Segments(bits, roadmap, 0.0), coverage_bound(bits, earliest, BUDGET), len(samples)


def search(bounded, measure):
    roadmap, segments, _, num = bounded
    task = Task(3, 0, np.zeros(segments.bits.shape[2], np.uint64), num, measure)
    return TourAnnealer(segments, roadmap, task, seed=1)


@settings(max_examples=20, deadline=None)
@given(stops=st.lists(st.tuples(st.integers(0, 60), st.integers(-1, 35), st.sampled_from((-1, 1))), max_size=12))
def test_no_tour_exceeds_the_upper_bound(bounded, stops):
    roadmap, _, bound, num = bounded
    tour = [(place % len(roadmap.places_m), yaw, side) for place, yaw, side in stops]
    searched = search(bounded, Measure("auc", BUDGET, num))
    coverage = searched.coverage(tour)
    inside = coverage.steps <= BUDGET
    assert (coverage.samples[inside] <= bound[coverage.steps[inside]]).all()
    assert (np.diff(bound) >= 0).all()
    assert bound[-1] <= num


@pytest.mark.parametrize("name", MEASURES)
def test_the_search_makes_its_measure_better_within_the_budget(bounded, name):
    _, _, bound, num = bounded
    searched = search(bounded, Measure(name, BUDGET, num))
    found = searched.anneal([], 250)

    assert searched.cost(found) < 0.5 * searched.cost([])
    steps, covered, _, _ = searched.coverage(found)
    at_end = np.interp(BUDGET, steps, covered)
    assert at_end > 0.6 * bound[-1]


def test_what_no_frame_covers_counts_from_the_start():
    bits = np.zeros((2, 36, 1), np.uint64)
    bits[0, 3], bits[1, 5] = 0b1, 0b11
    earliest = np.full((2, 36), 10)
    earliest[1] = 20
    bound = coverage_bound(bits, earliest, 30)
    assert bound[[0, 9, 10, 19, 20, 30]].tolist() == [62, 62, 63, 63, 64, 64]


def test_each_measure_prefers_its_own_tour():
    early, late = (np.array([10, 90]), np.array([80, 80])), (np.array([60, 90]), np.array([10, 100]))
    auc, end = (Measure(name, 100, 100) for name in MEASURES)
    assert auc.cost(*early) < auc.cost(*late)
    assert end.cost(*late) < end.cost(*early)
    # What comes after the budget does not count, within a segment in proportion.
    assert Measure("end", 50, 100).cost(np.array([0, 100]), np.array([0, 100])) == pytest.approx(25.0 + 0.05 * 37.5)


def test_a_pose_is_not_reached_before_its_turns_and_its_way(rooms):
    _, area = rooms
    places = np.array([[-1.5, 0.0], [-0.5, 1.0], [2.0, -1.0]])
    least = earliest_steps(area, places, np.array([-1.5, 0.0]), 2, 0.1)
    assert least[0, 2] == 0
    assert least[0, 35] == least[0, 5] == 3
    # Round the wall by the door, not through it.
    straight = math.dist(places[0], places[2]) / FORWARD_STEP_M
    assert least[2, 2] > straight


def trajectory():
    """Ahead, half around to the left, ahead, a turn too small to be a look, ahead."""
    poses, pose = [], Pose2(0.0, 0.0, 0.0)
    for action, times in (("ahead", 20), ("left", 24), ("ahead", 4), ("left", 2), ("ahead", 20)):
        for _ in range(times):
            if action == "left":
                pose = Pose2(pose.x_m, pose.y_m, pose.yaw_rad + TURN_STEP_RAD)
            else:
                x, y = pose.xy_m + 0.065 * np.array([math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)])
                pose = Pose2(float(x), float(y), pose.yaw_rad)
            poses.append(pose)
    return poses


def test_a_run_becomes_the_tour_that_it_drove():
    places = []

    def place_at(pose):
        places.append(pose.xy_m)
        return len(places) - 1

    def yaw_at(pose):
        return round(pose.yaw_rad / TURN_STEP_RAD) % 36

    stops = stops_along(trajectory(), place_at, yaw_at, 500)

    looks = [(yaw, side) for _, yaw, side in stops if yaw != NO_YAW]
    assert looks == [(18, 1), (24, 1)]
    assert all(shorter_side(a, b) == 1 for a, b in itertools.pairwise((0, 18)))
    assert any(yaw == NO_YAW for _, yaw, _ in stops)
    assert stops_along(trajectory(), place_at, yaw_at, 10) == []
    assert stops_along([], place_at, yaw_at, 10) == []


def test_a_folder_without_a_run_is_named(tmp_path):
    with pytest.raises(PlanError, match="is no run to begin from"):
        read_trajectories(str(tmp_path))
    whole = '"action": "WAIT", "y_m": 0.0, "yaw_rad": 0.0, "collided": false, "moved_m": 0.0, "ms": {}'
    (tmp_path / "steps.jsonl").write_text(
        f'{{"step": 1, "x_m": 1e300, {whole}, "left_radps": 0.0, "right_radps": 0.0}}\n'
    )
    with pytest.raises(PlanError, match="is no run to begin from"):
        read_trajectories(str(tmp_path))


def test_the_oracle_is_no_worse_than_the_run_that_it_begins_from(rooms, bounded):
    _, _, _, num = bounded
    searched = search(bounded, Measure("auc", BUDGET, num))
    good = searched.anneal([], 60)
    assert searched.cost(searched.anneal(good, 20)) <= searched.cost(good)


def test_a_planner_bounds_what_its_scene_shows(rooms):
    truth, area = rooms
    start = Pose2(-1.5, 0.0, 0.0)
    planner = TourPlanner(SceneTruth(truth, area, CAMERA_ON_BASE, budget_steps=80), 10, start)
    bound = planner.upper_bound(start)
    assert len(bound) == 81
    assert 0.0 < bound[0] < bound[-1] <= 100.0
    assert int(count(np.zeros(1, np.uint64))) == 0


def test_a_run_that_is_cut_in_a_turn_looks_where_it_turned():
    driven = trajectory()
    # After 40 steps the robot has made 20 of its 24 turns at one place.
    stops = stops_along(driven, lambda pose: driven.index(pose), lambda pose: round(pose.yaw_rad / TURN_STEP_RAD), 40)
    assert [place for place, yaw, _ in stops if yaw != NO_YAW] == [39, 39]
