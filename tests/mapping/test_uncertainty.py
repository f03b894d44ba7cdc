from dataclasses import replace

import numpy as np

from anm_mj.mapping.uncertainty import predictive_variance


def _surface(room, rng, count=300):
    points = rng.uniform([0.0, 0.0, 0.2], [4.0, 3.0, 2.2], (count, 3))
    points[:, 0] = np.where(rng.random(count) < 0.5, 0.0, 4.0)
    return points


def test_the_same_seed_gives_the_same_variance(trained_map):
    points = np.random.default_rng(0).uniform(0.0, 2.0, (50, 3))
    first = trained_map.uncertainty(points)
    np.testing.assert_array_equal(first, trained_map.uncertainty(points))
    assert (first > 0.0).all()


def test_the_closed_form_agrees_with_four_hundred_passes(trained_map, room):
    points = _surface(room, np.random.default_rng(0))
    config = replace(trained_map.config.uncertainty, num_passes=400, noise_std=0.005)
    sampled = predictive_variance(trained_map.backend, points, config, seed=3)
    closed = predictive_variance(trained_map.backend, points, replace(config, method="closed_form"), seed=3)
    ratio = sampled / closed
    # The sample variance of 400 passes itself scatters by 7 %.
    assert abs(np.median(ratio) - 1.0) < 0.1
    assert (np.abs(ratio - 1.0) < 0.3).mean() > 0.95


def test_colour_counts_as_much_as_its_weight_says(trained_map, room):
    points = _surface(room, np.random.default_rng(0), 20)
    config = trained_map.config.uncertainty
    variances = [
        predictive_variance(trained_map.backend, points, replace(config, color_weight=w), seed=0)
        for w in (0.0, 1.0, 2.0)
    ]
    np.testing.assert_allclose(variances[2] - variances[1], variances[1] - variances[0], rtol=1e-2, atol=1e-6)
    assert (variances[1] > variances[0]).all()


def test_perturbing_leaves_the_map_as_it_was(trained_map, room):
    points = _surface(room, np.random.default_rng(0), 20)
    before = trained_map.sdf(points)
    trained_map.uncertainty(points)
    np.testing.assert_array_equal(trained_map.sdf(points), before)
