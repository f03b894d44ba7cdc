"""The motion from one image to the next, in a room with a closed form."""

import math

import numpy as np
import pytest

from anm_mj.localisation.frame_to_images import FrameToImages, compared_with
from anm_mj.localisation.image_odometry import ImageOdometry
from anm_mj.localisation.key_images import KeyImages, key_image
from anm_mj.localisation.localisation_config import LocalisationConfig
from anm_mj.localisation.motion import MotionModel
from anm_mj.localisation.registration import FREE, PLANAR, Prior
from anm_mj.localisation.se3 import camera_motion
from anm_mj.types import Observation
from tests.mapping.ray_room import Room

CONFIG = LocalisationConfig()
BEFORE = np.diag([0.02, 0.02, 0.01]) ** 2
TURN = math.radians(10.0)


def expected(before: Observation, after: Observation) -> Prior:
    """By an odometry that measures the motion between two frames rightly if these state it rightly."""
    model = MotionModel(CONFIG.motion, PLANAR, has_odometry=True)
    model.move(np.eye(4), before.T_world_camera)
    return model.prior(before.T_world_camera, BEFORE, after.T_world_camera)


def followed(before: Observation, after: Observation, prior: Prior, *, doubtful: bool) -> Prior | None:
    images, compared = one_after_another(before, after, has_odometry=len(prior.covariance) == 3)
    return images.follow(compared, prior, doubtful=doubtful)


def one_after_another(
    before: Observation, after: Observation, *, has_odometry: bool = True
) -> tuple[ImageOdometry, FrameToImages]:
    images = ImageOdometry(CONFIG, has_odometry=has_odometry)
    images.see(key_image(before, CONFIG.key_images.longest_px))
    kept, image = KeyImages(CONFIG.key_images), key_image(after, CONFIG.key_images.longest_px)
    return images, compared_with([], after, image, 800, kept, CONFIG, 0.0, np.random.default_rng(0))


@pytest.mark.parametrize("wrong_deg", [0.0, 3.0, 8.0, -8.0])
def test_it_finds_a_turn_that_odometry_measured_wrong(room: Room, wrong_deg: float) -> None:
    before, after = room.observe(1.5, 1.5, 0.3, size=96), room.observe(1.52, 1.5, 0.3 + TURN, size=96)
    told = room.observe(1.5, 1.5, 0.3 + TURN + math.radians(wrong_deg), size=8)
    prior = expected(before, told)
    found = followed(before, after, prior, doubtful=True)
    assert found is not None
    off = camera_motion(after.T_world_camera, found.T_world_camera)
    assert np.linalg.norm(off[:3]) < 0.01
    assert abs(off[5]) < math.radians(0.3)
    # The doubt about the last pose stays, that about the motion is hardly any.
    assert found.motion_covariance is not None
    assert found.motion_covariance[2, 2] < 0.2 * prior.motion_covariance[2, 2]
    kept = prior.covariance - prior.motion_covariance
    np.testing.assert_allclose(found.covariance - found.motion_covariance, kept, atol=1e-12)


def test_without_doubt_a_usual_error_of_odometry_is_taken_away(room: Room) -> None:
    before, after = room.observe(1.5, 1.5, 0.3, size=96), room.observe(1.5, 1.5, 0.3 + TURN, size=96)
    told = room.observe(1.5, 1.5, 0.3 + TURN + math.radians(1.0), size=8)
    found = followed(before, after, expected(before, told), doubtful=False)
    assert found is not None
    assert abs(camera_motion(after.T_world_camera, found.T_world_camera)[5]) < math.radians(0.2)


@pytest.mark.parametrize("moved_before", [(0.0, 0.0), (0.0, TURN), (0.065, 0.0), (0.065, -TURN), (0.0, 2.0 * TURN)])
@pytest.mark.parametrize("moved", [(0.0, TURN), (0.065, 0.0), (0.0, 1.8 * TURN), (0.13, 0.0), (0.18, 0.0)])
@pytest.mark.parametrize("yaw_rad", [0.3, 0.8])
def test_without_odometry_it_finds_motions_that_do_not_go_on_as_before(
    room: Room, moved_before: tuple[float, float], moved: tuple[float, float], yaw_rad: float
) -> None:
    x, yaw = moved_before
    ahead = np.array([math.cos(yaw_rad), math.sin(yaw_rad)])
    earlier = room.observe(*(1.5 - x * ahead), yaw_rad - yaw, size=96)
    before = room.observe(1.5, 1.5, yaw_rad, size=96)
    after = room.observe(*(1.5 + moved[0] * ahead), yaw_rad + moved[1], size=96)
    model = MotionModel(CONFIG.motion, FREE, has_odometry=False)
    model.move(np.linalg.inv(earlier.T_world_camera) @ before.T_world_camera, before.T_world_camera)
    prior = model.prior(before.T_world_camera, np.eye(6) * 1e-6, before.T_world_camera)
    found = followed(before, after, prior, doubtful=True)
    assert found is not None
    off = camera_motion(after.T_world_camera, found.T_world_camera)
    assert np.linalg.norm(off[:3]) < 0.02
    assert np.linalg.norm(off[3:]) < math.radians(0.5)


@pytest.mark.parametrize("slip", [(0.0, 20.0), (0.1, -25.0), (0.12, 0.0), (-0.1, 40.0)])
@pytest.mark.parametrize("moved", [(0.0, 0.0), (0.065, 0.0), (0.0, TURN)])
def test_wheels_that_slipped_are_told_by_images(
    room: Room, moved: tuple[float, float], slip: tuple[float, float]
) -> None:
    before = room.observe(1.5, 1.5, 0.3, size=96)
    after = room.observe(1.5 + moved[0], 1.5, 0.3 + moved[1], size=96)
    told = room.observe(1.5 + moved[0] + slip[0], 1.5, 0.3 + moved[1] + math.radians(slip[1]), size=8)
    prior = expected(before, told)
    images, compared = one_after_another(before, after)
    found = images.follow_slip(compared, prior)
    off = camera_motion(after.T_world_camera, found[0].T_world_camera)
    assert np.linalg.norm(off[:3]) < 0.01
    assert abs(off[5]) < math.radians(0.3)
    fits = [images.fit(compared, each.T_world_camera) for each in found]
    assert fits == sorted(fits, reverse=True)
    right = images.fit(compared, after.T_world_camera)
    assert fits[0] == pytest.approx(right, abs=0.02)
    # Too far off, the images have too little in common to be compared.
    wrong = images.fit(compared, prior.T_world_camera)
    assert math.isnan(wrong) or wrong < 0.97 * right


def test_images_of_other_places_show_no_motion(room: Room) -> None:
    before, after = room.observe(1.5, 1.5, 0.0, size=96), room.observe(1.5, 1.5, math.pi, size=96)
    assert followed(before, after, expected(before, before), doubtful=True) is None
    images, compared = one_after_another(before, after)
    assert images.follow_slip(compared, expected(before, before)) == []


def test_before_any_frame_there_is_no_motion(room: Room) -> None:
    frame = room.observe(1.5, 1.5, 0.0, size=96)
    images, kept = ImageOdometry(CONFIG, has_odometry=True), KeyImages(CONFIG.key_images)
    image = key_image(frame, CONFIG.key_images.longest_px)
    compared = compared_with([], frame, image, 800, kept, CONFIG, 0.0, np.random.default_rng(0))
    assert images.follow(compared, expected(frame, frame), doubtful=True) is None
    assert images.follow_slip(compared, expected(frame, frame)) == []
    assert math.isnan(images.fit(compared, frame.T_world_camera))
    images.see(image)
    first = Prior(frame.T_world_camera, BEFORE, PLANAR)
    assert images.follow(compared, first, doubtful=True) is None
