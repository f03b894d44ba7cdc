import numpy as np
import pytest

from anm_mj.evaluation.oracle.discretize import discretize, turn
from anm_mj.evaluation.oracle.segments import NO_YAW, Segments
from anm_mj.evaluation.oracle.tour_annealing import Measure, Task, TourAnnealer, greedy_tour
from anm_mj.evaluation.oracle.visibility import count
from anm_mj.geometry.polyline import NUM_HEADINGS
from tests.evaluation.oracle import reference

LONG = Measure("auc", 10**6, 640)


def search_in(views, seed=0, measure=Measure("auc", 400, 640)):  # noqa: B008
    roadmap, samples, bits = views
    segments = Segments(bits, roadmap, 0.0)
    place = int(roadmap.nearest(np.array([[-1.5, 0.0]]))[0])
    task = Task(place, 0, np.zeros(bits.shape[2], np.uint64), len(samples) // 2, measure)
    return TourAnnealer(segments, roadmap, task, seed), segments, task


def test_coverage_of_a_tour_is_that_of_its_frames(views):
    roadmap, _, bits = views
    search, _, task = search_in(views, measure=LONG)
    stops = [(5, 7, 1), (40, NO_YAW, 1), (40, 30, -1), (12, 3, 1)]

    place, yaw = task.place, task.yaw
    seen, curve = np.zeros(bits.shape[2], np.uint64), [0]
    for to, towards, side in stops:
        if to != place:
            start_m = roadmap.places_m[place]
            way = discretize(start_m, None, roadmap.path_m(place, to), roadmap, 0.0)
            xy_m, yaws = reference.frames(way, start_m, yaw, 0.0)
            for at, k in zip(roadmap.nearest(xy_m), yaws, strict=True):
                # A turn before a way is made at its beginning, which is the place itself.
                seen |= bits[at, k]
                curve.append(int(count(seen)))
            place, yaw = to, way.yaws[-1]
        for k in turn(yaw, towards, side) if towards != NO_YAW else []:
            seen |= bits[place, k]
            curve.append(int(count(seen)))
            yaw = k

    steps, covered, _, _ = search.coverage(stops)
    assert steps[-1] == len(curve) - 1
    assert [curve[k] for k in steps] == covered.tolist()


@pytest.mark.parametrize("measure", [LONG, Measure("end", 150, 640)])
def test_the_native_coverage_is_that_of_numpy(views, measure):
    roadmap, _, _ = views
    rng = np.random.default_rng(0)
    search, segments, task = search_in(views, measure=measure)
    _, own, _ = search_in(views, measure=measure)
    for _ in range(60):
        stops = [
            (int(rng.integers(len(roadmap.places_m))), int(rng.integers(-1, NUM_HEADINGS)), int(rng.choice([-1, 1])))
            for _ in range(rng.integers(0, 12))
        ]
        stops += stops[-1:]
        task.seen[:] = rng.integers(0, 2**63, task.seen.shape, np.uint64) * np.uint64(rng.integers(2))
        for found, expected in zip(search.coverage(stops), reference.tour_coverage(own, task, stops), strict=True):
            np.testing.assert_array_equal(found, expected)
        if rng.random() < 0.1:
            segments.clear()


@pytest.mark.parametrize("yaw_rad", [0.0, 0.7, -2.3])
def test_the_native_paths_are_those_of_numpy(views, yaw_rad):
    roadmap, _, bits = views
    segments = Segments(bits, roadmap, yaw_rad)
    lengths = []
    for a, b in np.random.default_rng(0).integers(len(roadmap.places_m), size=(400, 2)).tolist():
        steps, first, last, covers = segments._path(a, b)
        *expected, expected_covers = reference.roadmap_path(roadmap, bits, yaw_rad, a, b)
        assert [steps, first, last] == expected
        np.testing.assert_array_equal(covers, expected_covers)
        lengths.append(steps)
    assert max(lengths) > 60


def test_stops_beyond_the_budget_count_for_nothing(views):
    search, _, _ = search_in(views, measure=LONG)
    stops = search_in(views)[0].anneal([], 100)
    steps = search.coverage(stops).steps
    budget = int(steps[-1]) // 2
    limited, _, _ = search_in(views, measure=Measure("auc", budget, 640))

    found = limited.coverage(stops)

    assert 0 < found.num_stops < len(stops) == search.coverage(stops).num_stops
    assert found.steps[-1] >= budget
    np.testing.assert_array_equal(found.steps, steps[: len(found.steps)])
    assert limited.cost(stops) == limited.cost(stops[: found.num_stops])


def test_annealing_lowers_the_cost(views):
    roadmap, _, _ = views
    search, segments, task = search_in(views)
    begin = greedy_tour(segments, roadmap, task, 0.0)

    found = search.anneal(begin, 300)

    assert search.cost(found) < search.cost(begin)


def test_annealing_depends_on_the_seed_alone(views):
    found = [search_in(views, seed)[0].anneal([], 100) for seed in (0, 0, 1)]

    assert found[0] == found[1] != found[2]


def test_annealing_covers_most_of_what_there_is(views):
    search, _, _ = search_in(views)
    found = search.anneal([], 600)

    assert search.coverage(found).samples[-1] >= 0.8 * 640
    assert search.cost(found) < search.cost([])
