import math

import numpy as np
import pytest

from scripts.bench_uncertainty import rank_correlation, relative_area, sparsification_curve

ERROR = np.random.default_rng(0).exponential(1.0, 5000)


def test_the_curve_is_the_mean_of_what_remains():
    curve = sparsification_curve(np.array([1.0, 5.0, 3.0]), np.array([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(curve, [3.0, 3.0, 1.0])


def test_a_perfect_ranking_leaves_no_area_whatever_its_scale():
    assert relative_area(ERROR, ERROR) == 0.0
    assert relative_area(ERROR, np.log(ERROR)) == pytest.approx(0.0, abs=1e-12)


def test_a_constant_leaves_the_area_of_chance():
    assert relative_area(ERROR, np.ones(len(ERROR))) == pytest.approx(1.0)
    assert relative_area(ERROR, np.random.default_rng(1).random(len(ERROR))) == pytest.approx(1.0, abs=0.05)


def test_the_reverse_ranking_is_worse_than_chance():
    assert relative_area(ERROR, -ERROR) > 1.5


def test_a_better_ranking_has_the_smaller_area():
    noise = np.random.default_rng(1).standard_normal(len(ERROR))
    areas = [relative_area(ERROR, ERROR + spread * noise) for spread in (0.1, 1.0, 10.0)]
    assert areas == sorted(areas)


def test_the_order_within_equal_uncertainties_does_not_count():
    coarse = np.floor(2.0 * ERROR)
    order = np.random.default_rng(2).permutation(len(ERROR))
    assert relative_area(ERROR[order], coarse[order]) == pytest.approx(relative_area(ERROR, coarse), rel=1e-9)


def test_equal_errors_leave_nothing_to_rank():
    assert relative_area(np.ones(10), np.arange(10.0)) == 0.0


def test_rank_correlation_sees_order_alone():
    assert rank_correlation(ERROR, ERROR**3) == pytest.approx(1.0)
    assert rank_correlation(ERROR, -ERROR) == pytest.approx(-1.0)
    assert math.isnan(rank_correlation(ERROR, np.ones(len(ERROR))))
