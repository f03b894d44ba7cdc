"""The noise that patterns are made of."""

import numpy as np
import pytest

from anm_mj.scene.generation.textures import hashed, noise


def test_noise_is_continuous_and_fills_its_range():
    line = np.stack([np.linspace(-20.0, 20.0, 40_001), np.full(40_001, 0.3)], axis=-1)

    values = noise(line)

    assert np.abs(np.diff(values)).max() < 0.005
    assert values.min() < 0.2
    assert values.max() > 0.8


def test_hashed_numbers_are_evenly_spread():
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(-100, 100), np.arange(-100, 100)))

    values = hashed(i, j, 4)

    assert np.histogram(values, 10, (0.0, 1.0))[0] == pytest.approx(len(values) / 10, rel=0.06)
    assert np.corrcoef(values[:-1], values[1:])[0, 1] == pytest.approx(0.0, abs=0.02)
