import numpy as np

from anm_mj.evaluation.novel_views import candidate_poses

RNG = np.random.default_rng(0)


def test_the_same_seed_gives_the_same_poses():
    places = RNG.uniform(0.0, 5.0, (30, 2))
    assert candidate_poses(places, 3) == candidate_poses(places, 3)
    assert candidate_poses(places, 3) != candidate_poses(places, 4)
    assert sorted((p.x_m, p.y_m) for p in candidate_poses(places, 3)) == sorted(map(tuple, places.tolist()))
