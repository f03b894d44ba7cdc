import numpy as np

from anm_mj.planning.policies.gvg.candidate_places import HERE, CandidatePlaces
from anm_mj.planning.policies.gvg.gvg_config import GvgConfig

CONFIG = GvgConfig(max_candidates=2)


def places(xy_m, gain_m2, steps):
    vertex = np.array([HERE, *range(len(xy_m) - 1)])
    return CandidatePlaces(vertex, np.array(xy_m, float), np.array(gain_m2), np.array(steps, float), 0, CONFIG)


def test_shortlist_has_one_place_per_square():
    found = places([(0, 0), (2.2, 0.2), (2.8, 0.8), (4.5, 0.5)], [0.0, 1.0, 2.0, 1.0], [0, 30, 30, 60])
    assert found.shortlist(100.0).tolist() == [0, 2, 3]


def test_shortlist_is_limited():
    found = places([(0, 0), (2, 0), (4, 0), (6, 0)], [0.0, 1.0, 2.0, 3.0], [0, 10, 10, 10])
    assert found.shortlist(100.0).tolist() == [0, 3, 2]


def test_shortlist_leaves_little_gain_out():
    found = places([(0, 0), (2, 0), (4, 0)], [0.0, 0.5 * CONFIG.min_gain_m2, 1.0], [0, 10, 10])
    assert found.shortlist(100.0).tolist() == [0, 2]


def test_discount_grows_with_the_distance_of_the_gain_up_to_a_limit():
    def discount(steps):
        return places([(0, 0), (2, 0)], [0.0, 1.0], [0, steps]).discount_steps

    assert discount(10.0) == CONFIG.discount_steps
    assert discount(250.0) == 250.0
    assert discount(1e4) == CONFIG.max_discount_ratio * CONFIG.discount_steps
