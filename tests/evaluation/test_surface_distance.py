"""The native search against the distances to all triangles."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from anm_mj import _native
from anm_mj.evaluation.surface_distance import surface_distance
from tests.evaluation.triangle_distance import triangle_distance_squared


def to_all(points, corners):
    return np.array([triangle_distance_squared(np.tile(p, (len(corners), 1)), corners).min() for p in points]) ** 0.5


def test_triangle_distance_agrees_with_an_independent_implementation():
    rng = np.random.default_rng(3)
    triangles, points = rng.normal(size=(500, 3, 3)), rng.normal(size=(500, 3)) * 2.0
    nearest = trimesh.triangles.closest_point(triangles, points)
    expected = np.sum((nearest - points) ** 2, axis=1)
    assert triangle_distance_squared(points, triangles) == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_triangles_without_area_are_edges_or_points():
    line = np.array([[[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]])
    point = np.zeros((1, 3, 3))
    assert triangle_distance_squared(np.array([[1.5, 2.0, 0.0]]), line) == pytest.approx([4.0])
    assert triangle_distance_squared(np.array([[0.0, 3.0, 4.0]]), point) == pytest.approx([25.0])


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 1 << 30),
    st.integers(1, 80),
    st.integers(1, 200),
    st.sampled_from([0.01, 0.2, 4.0]),
    st.sampled_from([0.0, 0.01, 1.0]),
)
def test_native_distances_are_those_to_all_triangles(seed, num_points, num_triangles, size_m, thin):
    rng = np.random.default_rng(seed)
    # Small and large ones, slivers, and, without thickness, lines.
    middle = rng.uniform(-2.0, 2.0, (num_triangles, 1, 3))
    corners = middle + size_m * rng.normal(size=(num_triangles, 3, 3)) * np.array([1.0, thin, 1.0 if thin else 0.0])
    points = np.concatenate([rng.uniform(-3.0, 3.0, (num_points, 3)), corners[0]])
    faces = np.arange(3 * num_triangles).reshape(-1, 3)
    found = surface_distance(points, corners.reshape(-1, 3), faces)
    assert found == pytest.approx(to_all(points, corners), rel=1e-9, abs=1e-12)


def test_many_points_are_searched_by_several_threads():
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=1.0)
    points = np.random.default_rng(0).normal(size=(10_000, 3))
    found = surface_distance(points, np.asarray(mesh.vertices), np.asarray(mesh.faces))
    assert found == pytest.approx(np.abs(np.linalg.norm(points, axis=1) - 1.0), abs=2e-3)


def test_native_arguments_are_checked():
    distances = _native.triangle_distances
    with pytest.raises(ValueError, match="three corners"):
        distances(np.zeros((1, 2, 3)), np.zeros((1, 3)), np.zeros(1), 1)
    with pytest.raises(ValueError, match="a surface is needed"):
        distances(np.zeros((0, 3, 3)), np.zeros((1, 3)), np.zeros(1), 1)
    with pytest.raises(ValueError, match="has a distance"):
        distances(np.zeros((1, 3, 3)), np.zeros((2, 3)), np.zeros(1), 1)
    with pytest.raises(ValueError, match="one thread"):
        distances(np.zeros((1, 3, 3)), np.zeros((1, 3)), np.zeros(1), 0)
