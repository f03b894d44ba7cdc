import numpy as np

from anm_mj.evaluation.novel_views import candidate_poses, novel_places

RNG = np.random.default_rng(0)


def test_novel_places_are_far_from_the_trajectory():
    places = np.stack(np.meshgrid(np.linspace(0.0, 4.0, 41), np.linspace(0.0, 4.0, 41)), axis=-1).reshape(-1, 2)
    trajectory = np.array([[0.0, 0.0], [2.0, 2.0]])
    far = novel_places(places, trajectory, 0.5)
    assert 0 < len(far) < len(places)
    assert (np.linalg.norm(far[:, None] - trajectory, axis=2) > 0.5).all()


def test_the_same_seed_gives_the_same_poses():
    places = RNG.uniform(0.0, 5.0, (30, 2))
    assert candidate_poses(places, 3) == candidate_poses(places, 3)
    assert candidate_poses(places, 3) != candidate_poses(places, 4)
    assert sorted((p.x_m, p.y_m) for p in candidate_poses(places, 3)) == sorted(map(tuple, places.tolist()))
