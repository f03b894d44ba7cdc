import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anm_mj.bench.job import PLATFORM
from anm_mj.bench.statistics import (
    TASK,
    PairedDifference,
    bootstrap_interval,
    holm,
    paired_difference,
    restricted_steps,
)

SAME = (*TASK, *PLATFORM)


def rows(values, **platform):
    """A row per scene, start and value."""
    usual = {key: "usual" for key in PLATFORM}
    return [
        {"scene": scene, "start": start, "seed": 0, "budget": 100, "auc": value, **usual, **platform}
        for (scene, start), value in values.items()
    ]


def test_a_run_that_never_arrives_counts_with_its_budget():
    assert restricted_steps(float("nan"), 100) == 100.0
    assert restricted_steps(None, 100) == 100.0
    assert restricted_steps(40.0, 100) == 40.0


def test_starts_are_averaged_within_their_scene():
    first = rows({("a", 0): 3.0, ("a", 1): 5.0, ("b", 0): 10.0})
    second = rows({("a", 0): 1.0, ("a", 1): 1.0, ("b", 0): 1.0, ("c", 0): 7.0})

    difference = paired_difference(first, second, "auc", SAME)

    assert difference is not None
    assert difference.by_scene.mean() == pytest.approx((3.0 + 9.0) / 2.0)
    assert (len(difference.by_scene), difference.num_pairs) == (2, 3)
    assert difference.p_value is None
    assert difference.without_one == (2.0 + 1.0, 9.0)


def test_policies_are_compared_with_the_same_platform_only():
    first, second = rows({("a", 0): 3.0}), rows({("a", 0): 1.0}, sensor="d435i")

    assert paired_difference(first, second, "auc", SAME) is None
    difference = paired_difference(first, second, "auc", TASK)

    assert difference is not None
    assert difference.by_scene.mean() == 2.0
    assert difference.without_one is None


def test_without_a_pair_there_is_no_difference():
    assert paired_difference(rows({("a", 0): 1.0}), rows({("b", 0): 1.0}), "auc", SAME) is None
    assert paired_difference(rows({("a", 0): None}), rows({("a", 0): 1.0}), "auc", SAME) is None


def test_equal_differences_have_a_certain_mean():
    first, second = rows({(s, 0): 4.0 for s in "abcdef"}), rows({(s, 0): 1.5 for s in "abcdef"})
    difference = paired_difference(first, second, "auc", SAME)
    assert difference is not None
    assert bootstrap_interval(difference.by_scene) == (2.5, 2.5)
    assert difference.p_value == pytest.approx(2.0 / 2**6)


def test_p_values_are_adjusted_for_as_many_tests_as_there_are():
    assert holm([0.04, None, 0.01, 0.02]) == [pytest.approx(0.04), None, pytest.approx(0.03), pytest.approx(0.04)]
    assert holm([0.6, 0.9]) == [1.0, 1.0]
    assert PairedDifference(np.zeros(8), 8).p_value is None


@given(st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=20))
def test_the_interval_holds_the_mean_and_lies_within_the_values(values):
    array = np.array(values)
    low, high = bootstrap_interval(array)
    assert array.min() - 1e-9 <= low <= array.mean() + 1e-9
    assert array.mean() - 1e-9 <= high <= array.max() + 1e-9
    assert (low, high) == bootstrap_interval(array)


def test_the_interval_covers_the_true_mean_about_as_often_as_it_says():
    rng = np.random.default_rng(1)
    samples = rng.normal(2.0, 1.0, (400, 10))
    covered = sum(low <= 2.0 <= high for low, high in map(bootstrap_interval, samples))
    # Of the usual percentiles it would be 360.
    assert 370 <= covered <= 392
