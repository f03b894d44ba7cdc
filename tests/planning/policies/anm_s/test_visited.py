import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from anm_mj.planning.policies.anm_s.visited import num_within, within


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.integers(0, 30), st.integers(0, 30))
def test_as_many_places_are_near_a_point_as_lie_nearer_than_the_radius(seed, num_points, num_places):
    rng = np.random.default_rng(seed)
    # On a grid, so that some lie at exactly the radius.
    points, places = (rng.integers(0, 8, (num, 2)).astype(float) for num in (num_points, num_places))
    distance = np.linalg.norm(points[:, None] - places[None], axis=-1)
    assert num_within(points, list(places), 2.0).tolist() == (distance < 2.0).sum(axis=1).tolist()
    assert within(points, list(places), 2.0).tolist() == (distance < 2.0).any(axis=1).tolist()
