"""Outliers against counting the neighbours of every pixel one by one."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from anm_mj.depth_outliers import AGREEMENT, LEAST_M, outliers

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
    assert np.array_equal(outliers(depth_m, support), expected)
