"""How the noise of motions is learnt."""

import numpy as np

from anm_mj.localisation.localisation_config import MotionConfig
from anm_mj.localisation.motion import MotionNoise
from anm_mj.localisation.registration import PLANAR, Prior
from anm_mj.localisation.se3 import moved_camera

FRAMES = 200


def learnt(factor: float, doubt: float = 0.0) -> float:
    """The scale after motions whose errors are ``factor`` times those expected, from poses with a variance."""
    rng = np.random.default_rng(0)
    noise = MotionNoise(MotionConfig(learn_frames=FRAMES))
    covariance = np.diag([1e-4, 4e-4, 1e-4])
    for _ in range(FRAMES):
        scale = noise.scale
        motion = scale**2 * covariance
        prior = Prior(np.eye(4), motion + doubt * np.eye(3), PLANAR, motion)
        error = factor * np.linalg.cholesky(covariance) @ rng.standard_normal(3)
        noise.add(prior, moved_camera(prior.T_world_camera, PLANAR @ error), scale)
    return noise.scale


def test_noise_is_believed_as_it_says_where_it_is_right_or_too_large() -> None:
    assert MotionNoise(MotionConfig()).scale == 1.0
    assert 1.0 <= learnt(1.0) < 1.15
    assert learnt(0.2) == 1.0


def test_larger_noise_is_learnt() -> None:
    assert 4.0 < learnt(5.0) < 6.0


def test_a_pose_stated_with_caution_does_not_hide_the_noise_of_motions() -> None:
    # With all of that doubt it would be 3.9.
    assert 4.3 < learnt(5.0, doubt=0.001) < 6.0
