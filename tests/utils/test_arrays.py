import numpy as np

from anm_mj.utils.arrays import embed, values_at


def test_embed_keeps_values_and_dtype():
    array = np.array([[1, 2], [3, 4]], np.int8)
    larger = embed(array, (4, 5), np.array([1, 2]), -1)
    assert larger.dtype == np.int8
    assert np.array_equal(larger[1:3, 2:4], array)
    assert (larger == -1).sum() == 16


def test_values_at_cells_beyond_an_array_are_the_given_one():
    array = np.arange(6, dtype=np.int8).reshape(2, 3)
    cells = np.array([[[0, 0], [1, 2]], [[-1, 1], [1, 3]]])
    found = values_at(array, cells, 9)
    assert found.dtype == np.int8
    assert found.tolist() == [[0, 5], [9, 9]]
    assert values_at(array, np.array([1, 0]), 9) == 3


def test_embed_takes_an_empty_array():
    assert np.isinf(embed(np.zeros((0, 0), np.float32), (2, 3), np.zeros(2, int), np.inf)).all()
