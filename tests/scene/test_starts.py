"""Where episodes begin."""

import math

import numpy as np

from anm_mj.scene.folder import load_scene
from anm_mj.scene.navigable import is_clear, sample_start
from anm_mj.types import DEFAULT_FOOTPRINT


def test_starts_are_clear_and_uniform():
    scene = load_scene("home")
    random = np.random.default_rng(0)
    starts = [sample_start(scene, DEFAULT_FOOTPRINT, random) for _ in range(60)]
    assert all(is_clear(scene, start, DEFAULT_FOOTPRINT) for start in starts)
    xy = np.array([start.xy_m for start in starts])
    extent = scene.bounds_m[1, :2] - scene.bounds_m[0, :2]
    assert (np.ptp(xy, axis=0) > 0.6 * extent).all()
    yaw = np.array([start.yaw_rad for start in starts])
    assert ((-math.pi < yaw) & (yaw <= math.pi)).all()
    assert np.histogram(yaw, bins=4, range=(-math.pi, math.pi))[0].min() > 5


def test_same_seed():
    scene = load_scene("home")
    first, second = (sample_start(scene, DEFAULT_FOOTPRINT, np.random.default_rng(5)) for _ in range(2))
    assert first == second
