import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from anm_mj.planning.distance_transform import capped_distance_cells


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31), st.integers(1, 12), st.floats(0.5, 0.999))
def test_distances_are_exact_up_to_the_cap(seed, cap, share):
    free = np.random.default_rng(seed).random((23, 31)) < share
    exact = np.asarray(ndimage.distance_transform_edt(free)) if not free.all() else np.full(free.shape, np.inf)
    assert np.allclose(capped_distance_cells(free, cap), np.minimum(exact, cap), atol=1e-5)


@pytest.mark.parametrize("cap", [181, 182, 300])
def test_distances_are_exact_up_to_large_caps(cap):
    free = np.ones((400, 250), bool)
    free[3, 5] = free[390, 240] = False
    exact = np.asarray(ndimage.distance_transform_edt(free))
    assert np.allclose(capped_distance_cells(free, cap), np.minimum(exact, cap), atol=1e-4)
