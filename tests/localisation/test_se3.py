"""Small motions of a camera."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from anm_mj.localisation.se3 import camera_motion, carried, moved_camera, rotation_of, rotation_vector


@pytest.mark.parametrize("angle", [0.0, 1e-10, 0.3, 2.0, np.pi - 1e-3])
def test_rotation_and_vector_are_inverse(angle: float) -> None:
    vector = angle * np.array([0.6, -0.48, 0.64])
    np.testing.assert_allclose(rotation_of(vector), Rotation.from_rotvec(vector).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(rotation_vector(rotation_of(vector)), vector, atol=1e-9)


def test_half_a_turn_has_an_axis() -> None:
    vector = rotation_vector(np.diag([-1.0, 1.0, -1.0]))
    np.testing.assert_allclose(np.abs(vector), [0.0, np.pi, 0.0], atol=1e-9)


def test_a_motion_leads_from_pose_to_pose() -> None:
    start = moved_camera(np.eye(4), np.array([1.0, -2.0, 0.5, 0.2, 0.1, -0.4]))
    change = np.array([0.1, 0.2, -0.3, 0.05, -0.6, 0.3])
    np.testing.assert_allclose(camera_motion(start, moved_camera(start, change)), change, atol=1e-12)


def test_covariance_is_carried_as_motions_are() -> None:
    rng = np.random.default_rng(0)
    start = moved_camera(np.eye(4), np.array([1.0, -2.0, 0.5, 0.2, 0.1, -0.4]))
    end = moved_camera(start, np.array([3.0, 1.0, 0.2, 0.3, -0.2, 1.0]))
    deviations = np.array([0.01, 0.02, 0.01, 0.003, 0.006, 0.009])
    errors = deviations * rng.standard_normal((4000, 6))
    ends = [camera_motion(end, moved_camera(start, error) @ np.linalg.inv(start) @ end) for error in errors]
    expected = carried(start, np.diag(deviations**2), end)
    spread = np.sqrt(np.diag(expected))
    assert spread[0] > 1.1 * deviations[0]
    np.testing.assert_allclose(
        np.cov(np.transpose(ends)) / np.outer(spread, spread), expected / np.outer(spread, spread), atol=0.06
    )
