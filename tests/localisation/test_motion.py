"""How the noise of motions is learnt, and what is expected where nothing shows them."""

import numpy as np

from anm_mj.localisation.localisation_config import MotionConfig
from anm_mj.localisation.motion import MotionModel
from anm_mj.localisation.registration import FREE, PLANAR, Prior
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


def of_steady_motion() -> tuple[MotionModel, np.ndarray]:
    """A camera that went 2 cm along its x axis in the last frame, and where it is."""
    model, step = MotionModel(MotionConfig(), FREE, has_odometry=False), np.eye(4)
    step[0, 3] = 0.02
    model.move(step, np.eye(4))
    return model, np.eye(4)


def test_a_camera_whose_motion_nothing_shows_is_held_and_its_deviation_grows_with_time() -> None:
    model, T = of_steady_motion()
    np.testing.assert_allclose(model.prior(T, np.zeros((6, 6)), np.eye(4)).T_world_camera[0, 3], 0.02)
    covariance = np.zeros((6, 6))
    deviations = []
    for _ in range(10):
        held = model.hold(T, covariance, has_image=False)
        np.testing.assert_array_equal(held.T_world_camera, T)
        covariance = held.covariance
        deviations.append(held.deviations)
    # In each frame it may have gone on by 2 cm, with the error of that: by half of it, and 1 cm.
    expected_m = np.sqrt(0.02**2 + (0.5 * 0.02) ** 2 + 0.01**2)
    np.testing.assert_allclose([each[0] for each in deviations], expected_m * np.arange(1, 11))
    np.testing.assert_allclose([each[1] for each in deviations], 0.015 * np.arange(1, 11))
    after = model.prior(T, covariance, np.eye(4))
    np.testing.assert_array_equal(after.T_world_camera, T)
    np.testing.assert_allclose(after.deviations[0], 11 * expected_m)


def test_the_motion_since_the_last_image_is_that_of_the_frames_without() -> None:
    model, T = of_steady_motion()
    first = model.hold(T, np.zeros((6, 6)), has_image=True)
    second = model.hold(T, first.covariance, has_image=False)
    prior = model.prior(T, second.covariance, np.eye(4))
    assert prior.motion_covariance is not None
    np.testing.assert_allclose(prior.covariance, 9.0 * first.covariance)
    np.testing.assert_allclose(prior.motion_covariance, 4.0 * first.covariance)


def test_after_a_gap_the_motion_of_a_frame_is_its_share() -> None:
    model, T = of_steady_motion()
    for _ in range(2):
        model.hold(T, np.zeros((6, 6)), has_image=False)
    found = moved_camera(T, np.array([0.03, 0.0, 0.06, 0.0, 0.3, 0.0]))
    model.move(found, np.eye(4))
    prior = model.prior(np.eye(4), np.zeros((6, 6)), np.eye(4))
    np.testing.assert_allclose(
        prior.T_world_camera, moved_camera(np.eye(4), np.array([0.01, 0.0, 0.02, 0.0, 0.1, 0.0])), atol=1e-12
    )


def test_a_jump_in_a_gap_goes_on_by_its_share() -> None:
    model, T = of_steady_motion()
    for _ in range(2):
        model.hold(T, np.zeros((6, 6)), has_image=True)
    far = moved_camera(T, np.array([0.0, 0.4, 0.0, 0.0, 0.0, 0.0]))
    onward = model.prior(far, np.zeros((6, 6)), np.eye(4), T)
    np.testing.assert_allclose(onward.T_world_camera[:3, 3], (0.0, 0.6, 0.0), atol=1e-12)
