"""How the noise of motions is learnt."""

import numpy as np

from anm_mj.localisation.localisation_config import MotionConfig
from anm_mj.localisation.motion import MotionNoise
from anm_mj.localisation.registration import PLANAR, Prior
from anm_mj.localisation.se3 import moved_camera

FRAMES = 200


def learnt(factor: float) -> float:
    """The scale after motions whose errors are ``factor`` times those expected."""
    rng = np.random.default_rng(0)
    noise = MotionNoise(MotionConfig(learn_frames=FRAMES))
    covariance = np.diag([1e-4, 4e-4, 1e-4])
    for _ in range(FRAMES):
        scale = noise.scale
        prior = Prior(np.eye(4), scale**2 * covariance, PLANAR)
        error = factor * np.linalg.cholesky(covariance) @ rng.standard_normal(3)
        noise.add(prior, moved_camera(prior.T_world_camera, PLANAR @ error), scale)
    return noise.scale


def test_noise_is_believed_as_it_says_where_it_is_right_or_too_large() -> None:
    assert MotionNoise(MotionConfig()).scale == 1.0
    assert 1.0 <= learnt(1.0) < 1.15
    assert learnt(0.2) == 1.0


def test_larger_noise_is_learnt() -> None:
    assert 4.0 < learnt(5.0) < 6.0
