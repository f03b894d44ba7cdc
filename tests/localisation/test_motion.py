"""How the noise of motions is learnt."""

import numpy as np

from anm_mj.localisation.localisation_config import MotionConfig
from anm_mj.localisation.motion import MotionModel
from anm_mj.localisation.registration import PLANAR, Prior
from anm_mj.localisation.se3 import moved_camera

FRAMES = 200


def learnt(factor: float, doubt: float = 0.0) -> float:
    """The scale after motions whose errors are ``factor`` times those expected, from poses with a variance."""
    rng = np.random.default_rng(0)
    model = MotionModel(MotionConfig(learn_frames=FRAMES), PLANAR, has_odometry=False)

    def next_frame() -> tuple[Prior, np.ndarray]:
        prior = model.prior(np.eye(4), doubt * np.eye(3), np.eye(4))
        assert prior.motion_covariance is not None
        return prior, prior.motion_covariance

    _, expected = next_frame()
    for _ in range(FRAMES):
        prior, _ = next_frame()
        error = factor * np.linalg.cholesky(expected) @ rng.standard_normal(3)
        model.learn(prior, moved_camera(prior.T_world_camera, PLANAR @ error))
    return float(np.sqrt(next_frame()[1][0, 0] / expected[0, 0]))


def test_noise_is_believed_as_it_says_where_it_is_right_or_too_large() -> None:
    assert 1.0 <= learnt(1.0) < 1.15
    assert learnt(0.2) == 1.0


def test_larger_noise_is_learnt() -> None:
    assert 4.0 < learnt(5.0) < 6.0


def test_a_pose_stated_with_caution_does_not_hide_the_noise_of_motions() -> None:
    # With all of that doubt it would be 3.9.
    assert 4.3 < learnt(5.0, doubt=0.001) < 6.0
