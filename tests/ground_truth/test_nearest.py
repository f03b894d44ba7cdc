"""The search against every distance there is, to the last bit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anm_mj import _native
from anm_mj.ground_truth.nearest import NearestSearch, spatial_order


def obvious(distance_m, places, points):
    off = places[:, None] - points[None]
    squared = off[:, :, 0] ** 2 + off[:, :, 1] ** 2 + off[:, :, 2] ** 2
    return np.minimum(distance_m, np.sqrt(squared.min(axis=1, initial=np.inf)))


def scattered(rng, count, size_m, repeated):
    """Points in a cube, or on the few places of a lattice in it, where many coincide."""
    points = rng.uniform(-size_m, size_m, (count, 3))
    return np.round(points / size_m * 2.0) * size_m / 2.0 if repeated else points


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 1 << 30),
    st.integers(1, 60),
    st.integers(0, 400),
    st.sampled_from([0.003, 0.1, 0.5, 3.0]),
    st.booleans(),
)
def test_distances_are_those_of_all_pairs(seed, num_places, num_points, size_m, repeated):
    rng = np.random.default_rng(seed)
    places, points = scattered(rng, num_places, size_m, repeated), scattered(rng, num_points, size_m, repeated)
    known = rng.choice([0.0, 0.001, 0.05, 0.7, 1.0, 20.0, np.inf], num_places)
    distance_m = known.copy()
    NearestSearch(places).lower(distance_m, points)
    assert np.array_equal(distance_m, obvious(known, places, points))


def test_many_places_are_searched_by_several_threads():
    rng = np.random.default_rng(0)
    places, points = rng.normal(size=(10_000, 3)), rng.normal(size=(500, 3))
    places = places[spatial_order(places)]
    distance_m = np.full(len(places), np.inf)
    NearestSearch(places).lower(distance_m, points)
    assert np.array_equal(distance_m, obvious(np.inf, places, points))


@pytest.mark.parametrize("axis", range(3))
def test_a_point_at_the_bound(axis):
    place = np.array([[0.3, -0.7, 1.1]])
    for step in range(-4, 5):
        point = place.copy()
        point[0, axis] += 0.05
        for _ in range(abs(step)):
            point[0, axis] = np.nextafter(point[0, axis], np.inf * step)
        distance_m = np.array([0.05])
        NearestSearch(place).lower(distance_m, point)
        assert distance_m[0] == obvious(0.05, place, point)[0]


def test_native_arguments_are_checked():
    lower = _native.lower_distances
    with pytest.raises(ValueError, match="three coordinates"):
        lower(np.zeros((1, 2)), np.zeros((1, 3)), np.zeros(1), 1)
    with pytest.raises(ValueError, match="has a distance"):
        lower(np.zeros((1, 3)), np.zeros((2, 3)), np.zeros(1), 1)
    with pytest.raises(ValueError, match="one thread"):
        lower(np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(1), 0)
