import numpy as np

from anm_mj.utils.arrays import embed


def test_embed_keeps_values_and_dtype():
    array = np.array([[1, 2], [3, 4]], np.int8)
    larger = embed(array, (4, 5), np.array([1, 2]), -1)
    assert larger.dtype == np.int8
    assert np.array_equal(larger[1:3, 2:4], array)
    assert (larger == -1).sum() == 16


def test_embed_takes_an_empty_array():
    assert np.isinf(embed(np.zeros((0, 0), np.float32), (2, 3), np.zeros(2, int), np.inf)).all()
