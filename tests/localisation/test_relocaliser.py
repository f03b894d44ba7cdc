"""Where a lost camera is expected."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from anm_mj.localisation.localisation_config import LocalisationConfig
from anm_mj.localisation.map_probe import MapProbe
from anm_mj.localisation.registration import PLANAR
from anm_mj.localisation.relocaliser import Relocaliser

CONFIG = LocalisationConfig()
STEP = np.eye(4)
STEP[0, 3] = 0.1


def after(num_frames: int, *, has_odometry: bool, followed: bool) -> Relocaliser:
    """Lost for so many frames, each a step on, in the last of which images may have lost the camera, too."""
    carried = replace(CONFIG, relocalisation=replace(CONFIG.relocalisation, carried_frames=5))
    finder = Relocaliser(carried, PLANAR, Mock(MapProbe))
    finder.restart(np.eye(4), has_odometry=has_odometry, followed=True)
    for number in range(num_frames):
        finder.move(STEP, followed=followed or number < num_frames - 1)
        finder._num_frames += 1
    return finder


@pytest.mark.parametrize("has_odometry", [True, False])
def test_a_camera_that_images_follow_was_not_carried(has_odometry: bool) -> None:
    T_expected = after(8, has_odometry=has_odometry, followed=True).T_expected
    assert T_expected is not None
    np.testing.assert_allclose(T_expected[:3, 3], (0.8, 0.0, 0.0))


def test_a_robot_that_images_lost_may_have_been_carried_later() -> None:
    assert after(4, has_odometry=True, followed=False).T_expected is not None
    assert after(5, has_odometry=True, followed=False).T_expected is None


def test_a_camera_in_the_hand_that_images_lost_may_be_anywhere() -> None:
    assert after(1, has_odometry=False, followed=False).T_expected is None
