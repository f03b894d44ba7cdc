from itertools import pairwise

import numpy as np
import pytest

from anm_mj.evaluation.oracle.discretize import discretize
from anm_mj.evaluation.oracle.roadmap import Roadmap, spread_places
from tests.evaluation.oracle import reference


def test_paths_avoid_a_spot(rooms):
    _, area = rooms
    roadmap = Roadmap(area, 0.2)
    a, b = (int(k) for k in roadmap.nearest(np.array([[1.0, 0.0], [2.4, 0.0]])))
    obstacle = np.array([1.7, 0.0])
    before_m = roadmap.distance_m[a, b]

    roadmap.avoid(obstacle)

    assert before_m < roadmap.distance_m[a, b] < 2.5


def test_a_path_leads_through_the_door(rooms):
    _, area = rooms
    roadmap = Roadmap(area, 0.2)
    a, b = (int(k) for k in roadmap.nearest(np.array([[-1.0, -0.4], [1.0, -1.0]])))

    path = np.concatenate([roadmap.places_m[[a]], roadmap.path_m(a, b)])

    assert path[-1] == pytest.approx(roadmap.places_m[b])
    assert path[:, 1].max() > 0.6
    dense = np.concatenate([np.linspace(p, q, 60) for p, q in pairwise(path)])
    assert (area.cells(dense.astype(np.float32)) >= 0).all()
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    assert length <= roadmap.distance_m[a, b] + 1e-5
    assert len(spread_places(area, 0.2)) == len(roadmap.places_m)


def test_a_discrete_path_arrives_with_few_turns(views):
    roadmap, _, _ = views
    for target in ([0.9, 0.2], [2.0, 1.0], [1.4, -0.6]):
        goal = np.array(target)
        way = discretize(np.array([0.5, 0.0]), 0, goal[None], roadmap, 0.0)
        assert np.linalg.norm(way.end_m - goal) < 0.13
        assert len(way.yaws) <= 2
        xy_m, yaws = reference.frames(way, np.array([0.5, 0.0]), 0, 0.0)
        assert xy_m[-1] == pytest.approx(way.end_m)
        moved = np.linalg.norm(np.diff(np.concatenate([[[0.5, 0.0]], xy_m]), axis=0), axis=1)
        turned_by = np.abs((np.diff([0, *yaws]) + 18) % 36 - 18)
        assert np.all((moved > 0.06) ^ (turned_by == 1))
