"""The verdict on a frame, by what the map says of it, and where tracking has a frame after a jump."""

import math
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from anm_mj.localisation.frame_to_images import FrameToImages
from anm_mj.localisation.image_odometry import ImageOdometry
from anm_mj.localisation.localisation_config import LocalisationConfig, RegistrationConfig
from anm_mj.localisation.map_probe import Agreement, MapProbe
from anm_mj.localisation.registration import FREE, PLANAR, Prior, Registration, RegistrationProblem
from anm_mj.localisation.tracking import Tracked, Tracker, Verdict, judged
from anm_mj.mapping.alignment import AlignSettings, FramePoints, NormalEquations

PRIOR = Prior(np.eye(4), np.eye(6) * 1e-4, FREE)


def verdict(num_confirmed: int, num_contradicted: int, known: float, least_known_score: float) -> Verdict:
    """On a frame of 100 points, whose known ones fit the field."""
    confirmed, contradicted = np.arange(100) < num_confirmed, np.arange(100) >= 100 - num_contradicted
    probe = Mock(spec=MapProbe)
    probe.agreement.return_value = Agreement(confirmed, contradicted)
    found = Mock(spec=Registration, T_world_camera=np.eye(4), known=known, inliers=1.0, colors=1.0, prior_cost=0.0)
    return judged(Mock(spec=FramePoints), PRIOR, found, probe, LocalisationConfig(), 0.0, least_known_score)[0]


@pytest.mark.parametrize(
    ("num_confirmed", "num_contradicted", "known", "least_known_score", "expected"),
    [
        (0, 0, 0.0, 0.5, Verdict.UNKNOWN),
        (4, 2, 0.05, 0.9, Verdict.UNKNOWN),
        (15, 0, 0.15, 0.9, Verdict.FITS),
        (75, 25, 1.0, 0.7, Verdict.FITS),
        (75, 25, 1.0, 0.8, Verdict.CONTRADICTS),
        (60, 40, 1.0, 0.0, Verdict.CONTRADICTS),
    ],
)
def test_a_frame_is_held_against_what_the_map_knows_of_it(
    num_confirmed: int, num_contradicted: int, known: float, least_known_score: float, expected: Verdict
) -> None:
    assert verdict(num_confirmed, num_contradicted, known, least_known_score) is expected


class Wall(MapProbe):
    """A map of one wall: where the camera's x is 0, all points lie on it."""

    def __init__(self) -> None:
        pass

    def align(self, points: FramePoints, T_world_camera: np.ndarray, settings: AlignSettings) -> NormalEquations:
        distance = np.full(len(points), T_world_camera[0, 3])
        square = (distance / settings.field_deviation_m) ** 2
        share = settings.kernel**2 / (settings.kernel**2 + square)
        weight = share**2 / settings.field_deviation_m**2
        row = np.eye(6)[0]
        hessian = np.stack((np.outer(row, row) * weight.sum(), np.zeros((6, 6))))
        gradient = np.stack((row * float(weight @ distance), np.zeros(6)))
        facts = np.array([[float(share @ square), float((share**2).sum()), len(points)], [0.0, 0.0, 0.0]])
        return NormalEquations(hessian, gradient, facts)

    def agreement(self, points: FramePoints, T_world_camera: np.ndarray) -> Agreement:
        is_there = np.full(len(points), abs(T_world_camera[0, 3]) < 0.02)
        return Agreement(is_there, ~is_there)

    def contradicted(self, points: FramePoints, T_world_camera: np.ndarray) -> float:
        return 0.0 if abs(T_world_camera[0, 3]) < 0.02 else 1.0

    def known(self, points_m: np.ndarray) -> np.ndarray:
        return np.ones(len(points_m), bool)


def prior_at(x_m: float) -> Prior:
    """Known to 1 cm."""
    T = np.eye(4)
    T[0, 3] = x_m
    return Prior(T, np.eye(3) * 0.01**2, PLANAR, np.eye(3) * 0.01**2)


def tracked(prior: Prior, after_far: Prior | None) -> Tracked:
    """A frame that the wall puts at x = 0, without images."""
    settings = RegistrationConfig(color_deviation=0.0)
    config = LocalisationConfig(registration=settings)
    tracker = Tracker(config, Wall(), Mock(spec=ImageOdometry), has_odometry=True)
    camera = np.random.default_rng(0).random((300, 3)).astype(np.float32)
    frame = FramePoints(camera, camera, np.zeros(300, np.float32), np.ones(300, np.float32))
    problem = RegistrationProblem(frame, prior, tracker._probe, settings)
    return tracker.track(problem, after_far, None, np.random.default_rng(0), misfits=1)


class DoorMoved(Wall):
    """The same, where from y = 0.2 on what is seen is not as it was."""

    def agreement(self, points: FramePoints, T_world_camera: np.ndarray) -> Agreement:
        is_there = np.full(len(points), abs(T_world_camera[0, 3]) < 0.02 and T_world_camera[1, 3] < 0.2)
        return Agreement(is_there, ~is_there)


class Unknown(Wall):
    """A map that knows nothing of what is seen."""

    def agreement(self, points: FramePoints, T_world_camera: np.ndarray) -> Agreement:
        return Agreement(np.zeros(len(points), bool), np.zeros(len(points), bool))

    def known(self, points_m: np.ndarray) -> np.ndarray:
        return np.zeros(len(points_m), bool)


def tracked_with(images: Mock, prior: Prior, probe: type[Wall] = Wall) -> Tracked:
    """A frame that the wall puts at x = 0, after some that fitted the map and each other by 0.9."""
    settings = RegistrationConfig(color_deviation=0.0)
    tracker = Tracker(LocalisationConfig(registration=settings), probe(), images, has_odometry=True)
    for _ in range(3):
        tracker.history.add(1.0, 0.9, 0.9)
    camera = np.random.default_rng(0).random((300, 3)).astype(np.float32)
    frame = FramePoints(camera, camera, np.zeros(300, np.float32), np.ones(300, np.float32))
    problem = RegistrationProblem(frame, prior, tracker._probe, settings)
    return tracker.track(problem, None, Mock(spec=FrameToImages), np.random.default_rng(0), misfits=0)


@pytest.mark.parametrize(("fit_there", "is_moved"), [(0.9, False), (0.8, True), (math.nan, True)])
def test_a_frame_unlike_the_last_one_is_where_images_lead_along_the_wall(fit_there: float, is_moved: bool) -> None:
    """The wall fits wherever x is 0, and would never tell that the robot stands 0.3 m beside where odometry has it."""
    images, there = Mock(spec=ImageOdometry), np.eye(4)
    there[1, 3] = 0.3
    images.fit.side_effect = lambda _, T: 0.9 if T[1, 3] > 0.2 else fit_there
    images.follow_slip.return_value = [replace(prior_at(0.0), T_world_camera=there)]
    found = tracked_with(images, prior_at(0.0))
    assert found.verdict is Verdict.FITS
    assert found.is_followed is is_moved
    assert found.found.T_world_camera[1, 3] == pytest.approx(0.3 * is_moved, abs=0.01)
    # How far odometry was off is learnt from what odometry said.
    assert found.expected.T_world_camera[1, 3] == 0.0


@pytest.mark.parametrize(
    ("fit_of_prior", "expected"), [(0.5, Verdict.FITS), (math.nan, Verdict.FITS), (0.9, Verdict.JUMPS)]
)
def test_a_jump_is_believed_at_once_where_the_last_image_tells_it_from_its_prior(
    fit_of_prior: float, expected: Verdict
) -> None:
    """Odometry slips by 10 cm. Along a plain wall an image tells nothing, and odometry stands."""
    images = Mock(spec=ImageOdometry)
    images.fit.side_effect = lambda _, T: 0.9 if abs(T[0, 3]) < 0.05 else fit_of_prior
    images.follow.return_value = None
    found = tracked_with(images, prior_at(0.1))
    assert found.verdict is expected
    assert abs(found.found.T_world_camera[0, 3]) < 0.02
    images.follow_slip.assert_not_called()


def test_a_frame_that_fits_where_the_last_image_says_it_cannot_be_is_not_mapped() -> None:
    images, there = Mock(spec=ImageOdometry), np.eye(4)
    there[1, 3] = 0.3
    images.fit.side_effect = lambda _, T: 0.9 if T[1, 3] > 0.2 else math.nan
    images.follow_slip.return_value = [replace(prior_at(0.0), T_world_camera=there)]
    found = tracked_with(images, prior_at(0.0), DoorMoved)
    assert found.verdict is Verdict.CONTRADICTS
    np.testing.assert_array_equal(found.prior.T_world_camera, there)


@pytest.mark.parametrize(("fit_there", "is_moved"), [(0.9, True), (0.8, False)])
def test_before_unknown_surface_images_tell_a_far_motion_only_if_they_fit_as_usual(
    fit_there: float, is_moved: bool
) -> None:
    images, far = Mock(spec=ImageOdometry), prior_at(0.3)
    images.fit.side_effect = lambda _, T: fit_there if T[0, 3] > 0.2 else 0.9
    images.follow.side_effect = lambda *_, doubtful, **__: far if doubtful else None
    found = tracked_with(images, prior_at(0.0), Unknown)
    assert found.verdict is Verdict.UNKNOWN
    assert (found.prior is far) == found.is_followed == is_moved


def test_a_frame_that_images_lead_nowhere_keeps_the_place_that_the_map_gives_it() -> None:
    images = Mock(spec=ImageOdometry)
    images.fit.return_value = 0.5
    images.follow_slip.return_value = []
    found = tracked_with(images, prior_at(0.0))
    assert found.verdict is Verdict.FITS
    assert not found.is_followed


def test_a_frame_far_from_its_prior_is_a_jump_until_the_next_one_confirms_it() -> None:
    """Odometry slips by 10 cm, which registration undoes; the frame after it stands where the first one jumped to."""
    jumped = tracked(prior_at(0.1), None)
    assert jumped.verdict is Verdict.JUMPS
    assert abs(jumped.found.T_world_camera[0, 3]) < 0.02

    there = Prior(jumped.found.T_world_camera, jumped.found.covariance + np.eye(3) * 0.01**2, PLANAR)
    confirmed = tracked(prior_at(0.1), there)
    assert confirmed.verdict is Verdict.FITS
    np.testing.assert_array_equal(confirmed.expected.T_world_camera, there.T_world_camera)


def test_a_jump_that_the_next_frame_does_not_confirm_is_forgotten() -> None:
    """The first frame was registered wrongly to x = 0.2; the next one stands where odometry has it."""
    fits = tracked(prior_at(0.0), prior_at(0.2))
    assert fits.verdict is Verdict.FITS
    assert fits.expected.T_world_camera[0, 3] == 0.0

    elsewhere = tracked(prior_at(0.1), prior_at(0.2))
    assert elsewhere.verdict is Verdict.JUMPS
    assert elsewhere.expected.T_world_camera[0, 3] == 0.1
