import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from anm_mj.planning.policies.gvg.gain_cache import GainCache
from anm_mj.planning.policies.gvg.views import NUM_AZIMUTHS

SIDE_M = 0.5


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31))
def test_keeps_the_last_gain_of_each_square(seed):
    rng = np.random.default_rng(seed)
    kept, expected = GainCache(SIDE_M), {}
    for _ in range(4):
        places, gains = rng.uniform(-4, 4, (20, 2)), rng.random((20, NUM_AZIMUTHS))
        kept.store(places, gains)
        squares = [tuple(square) for square in np.floor(places / SIDE_M).astype(int).tolist()]
        expected.update(zip(squares, gains, strict=True))
        low = rng.uniform(-4, 3, 2)
        kept.invalidate(low, low + 1.0)
        for square in [s for s in expected if all(np.less_equal(np.multiply(s, SIDE_M), low + 1.0))]:
            if all(np.greater_equal(np.add(square, 1) * SIDE_M, low)):
                del expected[square]
        asked = np.concatenate([places, rng.uniform(-4, 4, (20, 2))])
        found, known = kept.lookup(asked)
        for place, gain, is_known in zip(np.floor(asked / SIDE_M).astype(int).tolist(), found, known, strict=True):
            assert is_known == (tuple(place) in expected)
            assert np.array_equal(gain, expected.get(tuple(place), np.zeros(NUM_AZIMUTHS)))


def test_is_empty_at_first():
    gains, known = GainCache(SIDE_M).lookup(np.array([[0.1, -0.2]]))
    assert not known.any()
    assert not gains.any()
