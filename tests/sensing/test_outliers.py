"""Outliers against counting the neighbours of every pixel one by one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from anm_mj.sensing.outliers import AGREEMENT, LEAST_M, numpy_outliers, outliers
from anm_mj.utils.native_functions import native_function

_DEPTH = st.sampled_from([np.nan, np.inf, 0.0, -1.0, 0.3, 0.34, 0.36, 1.0, 1.09, 1.11, 1.2, 3.0]).map(np.float32)


@given(hnp.arrays(np.float32, hnp.array_shapes(min_dims=2, max_dims=2, max_side=6), elements=_DEPTH), st.integers(1, 5))
def test_outliers_are_those_that_too_few_of_eight_neighbours_agree_with(depth_m, support):
    expected = np.zeros(depth_m.shape, bool)
    for row, col in np.ndindex(depth_m.shape):
        own = depth_m[row, col]
        if not (np.isfinite(own) and own > 0):
            continue
        beside = depth_m[max(row - 1, 0) : row + 2, max(col - 1, 0) : col + 2]
        agreeing = np.count_nonzero(
            np.isfinite(beside)
            & (beside > 0)
            & (np.abs(beside - own) <= max(np.float32(AGREEMENT) * own, np.float32(LEAST_M)))
        )
        # It agrees with itself.
        expected[row, col] = agreeing - 1 < support
    assert np.array_equal(numpy_outliers(depth_m, support), expected)
    assert np.array_equal(outliers(depth_m, support), expected)


@pytest.mark.skipif(native_function("depth_outliers") is None, reason="the native engine was not built")
@given(st.integers(0, 1 << 30), st.integers(1, 3))
def test_the_native_outliers_are_those_of_numpy_at_depths_of_every_size(seed, support):
    rng = np.random.default_rng(seed)
    # Neighbours that differ by about as much as may be.
    depth_m = np.exp(rng.uniform(-3.0, 3.0)) * (1.0 + rng.uniform(-0.12, 0.12, (9, 11)))
    depth_m[rng.random(depth_m.shape) < 0.3] = np.nan
    depth_m = depth_m.astype(np.float32)
    assert np.array_equal(outliers(depth_m, support), numpy_outliers(depth_m, support))
