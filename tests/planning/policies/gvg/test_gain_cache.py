import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from anm_mj.planning.policies.gvg.gain_cache import GainCache

SIDE_M = 0.5


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31))
def test_the_latest_panorama_of_each_square_is_remembered(seed):
    rng = np.random.default_rng(seed)
    kept, expected = GainCache(SIDE_M, 3), {}
    for _ in range(4):
        places, panoramas = rng.uniform(-4, 4, (20, 2)), rng.random((20, 3))
        kept.remember(places, panoramas)
        squares = [tuple(square) for square in np.floor(places / SIDE_M).astype(int).tolist()]
        expected.update(zip(squares, panoramas, strict=True))
        low = rng.uniform(-4, 3, 2)
        kept.forget(low, low + 1.0)
        for square in [s for s in expected if all(np.less_equal(np.multiply(s, SIDE_M), low + 1.0))]:
            if all(np.greater_equal(np.add(square, 1) * SIDE_M, low)):
                del expected[square]
        asked = np.concatenate([places, rng.uniform(-4, 4, (20, 2))])
        found, known = kept.recall(asked)
        for place, panorama, is_known in zip(np.floor(asked / SIDE_M).astype(int).tolist(), found, known, strict=True):
            assert is_known == (tuple(place) in expected)
            assert np.array_equal(panorama, expected.get(tuple(place), np.zeros(3)))


def test_nothing_is_known_at_first():
    panoramas, known = GainCache(SIDE_M, 3).recall(np.array([[0.1, -0.2]]))
    assert not known.any()
    assert not panoramas.any()
