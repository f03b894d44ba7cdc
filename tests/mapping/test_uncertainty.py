from dataclasses import replace

import numpy as np
import pytest

from anm_mj.mapping.mapping_config import UncertaintyConfig, paper_mapping
from anm_mj.mapping.uncertainty import closed_form_variance, perturbed_variance, uncertainty_at
from scripts.bench_uncertainty import rank_correlation


def _surface(rng, count=300):
    points = rng.uniform([0.0, 0.0, 0.2], [4.0, 3.0, 2.2], (count, 3))
    points[:, 0] = np.where(rng.random(count) < 0.5, 0.0, 4.0)
    return points


@pytest.mark.parametrize("method", ["last_layer_variance", "closed_form", "perturbation"])
def test_the_same_seed_gives_the_same_variance(trained_map, method):
    points = np.random.default_rng(0).uniform(0.0, 2.0, (50, 3))
    uncertainty = replace(trained_map.config.uncertainty, method=method)
    config = replace(trained_map.config, uncertainty=uncertainty)
    first, second = (
        uncertainty_at(trained_map.backend, trained_map.occupancy.by_depth, points, config, seed=0) for _ in range(2)
    )
    np.testing.assert_array_equal(first, second)
    assert (first > 0.0).all()


def test_the_closed_form_agrees_with_four_hundred_passes(trained_map):
    points = _surface(np.random.default_rng(0))
    config = replace(trained_map.config.uncertainty, num_passes=400, noise_std=0.005)
    ratio = perturbed_variance(trained_map.backend, points, config, seed=3) / closed_form_variance(
        trained_map.backend, points, config
    )
    # The sample variance of 400 passes itself scatters by 7 %.
    assert abs(np.median(ratio) - 1.0) < 0.1
    assert (np.abs(ratio - 1.0) < 0.3).mean() > 0.95


def test_the_closed_form_ranks_as_four_hundred_passes_do_and_better_than_twenty(trained_map):
    points = trained_map.surface(np.array([2.0, 1.5]), 5.0).xyz_m
    config = trained_map.config.uncertainty
    many = perturbed_variance(trained_map.backend, points, replace(config, num_passes=400), seed=3)
    few = perturbed_variance(trained_map.backend, points, replace(config, num_passes=20), seed=4)
    closed = closed_form_variance(trained_map.backend, points, config)
    many, few, closed = (variance.astype(float) for variance in (many, few, closed))
    assert rank_correlation(closed, many) > 0.85
    assert rank_correlation(closed, many) > rank_correlation(few, many)


def test_colour_counts_as_much_as_its_weight_says(trained_map):
    points = _surface(np.random.default_rng(0), 20)
    for variance in (
        lambda config: closed_form_variance(trained_map.backend, points, config),
        lambda config: perturbed_variance(trained_map.backend, points, config, seed=0),
    ):
        none, once, twice = (variance(UncertaintyConfig(color_weight=weight)) for weight in (0.0, 1.0, 2.0))
        np.testing.assert_allclose(twice - once, once - none, rtol=1e-2, atol=1e-6)
        assert (once > none).all()


def test_perturbing_leaves_the_map_as_it_was(trained_map):
    points = _surface(np.random.default_rng(0), 20)
    before = trained_map.sdf(points)
    perturbed_variance(trained_map.backend, points, trained_map.config.uncertainty, seed=0)
    np.testing.assert_array_equal(trained_map.sdf(points), before)


def test_the_paper_preset_perturbs_twenty_times():
    config = paper_mapping().uncertainty
    assert (config.method, config.num_passes) == ("perturbation", 20)
