from dataclasses import replace

import numpy as np
import pytest

from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.last_layer import last_layer_variance, leverage, observation_density
from anm_mj.mapping.mapping_config import OccupancyConfig, quick_mapping
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.mapping.uncertainty import closed_form_variance
from anm_mj.types import OCCUPIED
from scripts.bench_uncertainty import relative_area


@pytest.fixture(scope="module")
def half_seen(tiny_config, room) -> NeuralMap:
    """Trained on a quarter turn towards +x."""
    neural_map = NeuralMap(tiny_config, seed=0, device="cpu")
    for step, yaw in enumerate(np.linspace(-0.8, 0.8, 8)):
        neural_map.integrate(room.observe(1.5, 1.5, float(yaw), size=128, step=step))
    return neural_map


def _fused(room, *places) -> DepthOccupancy:
    grid = DepthOccupancy(OccupancyConfig())
    for x, y in places:
        view = room.observe(x, y, 0.0, size=64)
        grid.integrate(view.depth_m, view.intrinsics, view.T_world_camera)
    return grid


WALL = np.array([[4.0, 0.5, 1.2], [4.0, 2.7, 1.3], [4.0, 2.6, 1.4]])
"""Points of the wall that the views look at."""


DENSITY_EXPONENT = quick_mapping().schedule.density_exponent


def test_observing_twice_doubles_the_density(room):
    once, twice = _fused(room, (2.0, 0.6)), _fused(room, (2.0, 0.6), (2.0, 0.6))
    np.testing.assert_allclose(observation_density(twice, WALL), 2.0 * observation_density(once, WALL))
    assert observation_density(once, WALL)[0] > 0.0


def test_half_the_distance_gives_four_times_the_density(room):
    rng = np.random.default_rng(0)
    patch = np.column_stack([np.full(500, 4.0), rng.uniform(0.3, 0.9, 500), rng.uniform(1.0, 1.4, 500)])
    near, far = (observation_density(_fused(room, (x, 0.6)), patch).mean() for x in (3.0, 2.0))
    assert near / far == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize("size", [64, 128, 256])
def test_as_many_observations_are_counted_as_the_focal_length_says(room, size):
    """Frames of every phase of the thinning see a wall 2 m away from the front."""
    grid = DepthOccupancy(OccupancyConfig())
    for _ in range(16):
        view = room.observe(2.0, 1.5, 0.0, size=size)
        grid.integrate(view.depth_m, view.intrinsics, view.T_world_camera)
    patch = np.mgrid[4:5, 1.2:1.8:13j, 1.0:1.4:9j].reshape(3, -1).T
    layers = np.concatenate([patch + np.array([dx, 0.0, 0.0]) for dx in (-0.05, 0.0, 0.05)])
    counted = observation_density(grid, layers).reshape(3, -1)
    counted_px = view.intrinsics.fx / {64: 1, 128: 1, 256: 2}[size]
    assert counted.sum(axis=0).mean() == pytest.approx(16 * (counted_px * grid.config.voxel_m / 2.0) ** 2, rel=0.2)


def test_density_is_zero_where_nothing_was_observed(room):
    assert (observation_density(DepthOccupancy(OccupancyConfig()), WALL) == 0.0).all()
    assert (observation_density(_fused(room, (2.0, 0.6)), WALL - [10.0, 0.0, 0.0]) == 0.0).all()


def test_last_layer_maps_hidden_features_to_the_sdf(trained_map):
    points = np.random.default_rng(0).uniform(0.0, 2.0, (40, 3))
    hidden = trained_map.backend.query_hidden(points)
    assert (hidden >= 0.0).all()
    s = hidden @ trained_map.backend.parameters()["sdf_out"][0]
    np.testing.assert_allclose(s, trained_map.backend.query_sdf(points), atol=1e-5)


def test_mean_leverage_is_the_number_of_axes(half_seen):
    voxels = np.argwhere(half_seen.occupancy_grid().state == OCCUPIED)
    grid = half_seen.occupancy_grid()
    places = grid.origin_m + (voxels[:, ::-1] + 0.5) * grid.resolution_m
    density = observation_density(half_seen.occupancy.by_depth, places)
    variance = leverage(half_seen.backend, half_seen.occupancy.by_depth, places, DENSITY_EXPONENT)
    assert np.average(variance, weights=density ** (1.0 - DENSITY_EXPONENT)) == pytest.approx(32.0, rel=0.1)


def test_unobserved_surface_stands_out(half_seen, room):
    rng = np.random.default_rng(0)
    seen = half_seen.surface(np.array([2.0, 1.5]), 5.0).xyz_m
    unseen = np.column_stack([np.zeros(500), rng.uniform(0.0, 3.0, 500), rng.uniform(0.0, 2.4, 500)])
    low, high = (
        last_layer_variance(half_seen.backend, half_seen.occupancy.by_depth, points, DENSITY_EXPONENT)
        for points in (seen, unseen)
    )
    assert np.percentile(high, 5) > np.percentile(low, 95)


def test_predicts_the_error_better_than_the_closed_form(half_seen, room):
    points = np.random.default_rng(0).uniform([0.0, 0.0, 0.0], [4.0, 3.0, 2.4], (20_000, 3))
    points = points[np.abs(half_seen.sdf(points)) < 0.01]
    error = np.abs(half_seen.sdf(points) - np.clip(room.sdf(points), -0.1, 0.1)).astype(float)
    by_last_layer = last_layer_variance(half_seen.backend, half_seen.occupancy.by_depth, points, DENSITY_EXPONENT)
    by_closed_form = closed_form_variance(half_seen.backend, points, half_seen.config.uncertainty)
    assert relative_area(error, by_last_layer) < 0.7 * relative_area(error, by_closed_form)


def test_loaded_map_has_the_uncertainty_of_the_saved_one(tiny_config, room, tmp_path):
    config = replace(tiny_config, uncertainty=replace(tiny_config.uncertainty, method="last_layer_variance"))
    saved = NeuralMap(config, seed=0, device="cpu")
    saved.integrate(room.observe(1.5, 1.5, 0.0))
    saved.save(tmp_path / "map.safetensors")
    points = np.random.default_rng(0).uniform(0.0, 2.0, (50, 3))
    np.testing.assert_array_equal(
        NeuralMap.load(tmp_path / "map.safetensors").uncertainty(points), saved.uncertainty(points)
    )


def test_empty_map_is_uncertain_everywhere(tiny_config):
    empty = NeuralMap(tiny_config, seed=0, device="cpu")
    assert (
        last_layer_variance(empty.backend, empty.occupancy.by_depth, np.zeros((3, 3)), DENSITY_EXPONENT) > 0.0
    ).all()


def test_how_fine_the_voxels_are_does_not_change_the_expected_error(tiny_config, room):
    def error_m(voxel_m: float) -> float:
        config = replace(tiny_config, occupancy=replace(tiny_config.occupancy, voxel_m=voxel_m))
        neural_map = NeuralMap(config, seed=0, device="cpu")
        for step in range(4):
            neural_map.integrate(room.observe(1.5, 1.5, 0.0, size=128, step=step))
        return float(np.median(neural_map.surface_errors(np.array([1.5, 1.5]), 6.0).error_m))

    assert error_m(0.1) == pytest.approx(error_m(0.05), rel=0.15)
    assert error_m(0.2) == pytest.approx(error_m(0.05), rel=0.25)
