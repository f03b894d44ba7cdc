import numpy as np
from numpy.testing import assert_allclose

from anm_mj.geometry.polyline import divided


def test_no_part_of_a_divided_polyline_is_too_long():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.1]])
    found = divided(points, 0.3)
    assert_allclose(found, [[0, 0], [0.25, 0], [0.5, 0], [0.75, 0], [1, 0], [1, 0.1]], atol=1e-12)
    assert_allclose(divided(points[:1], 0.3), points[:1])
    # Nothing moves where two corners are the same.
    assert_allclose(divided(points[[0, 0]], 0.3), points[[0, 0]])
