"""Which of several registrations is believed: with a field of one dimension that has a false minimum."""

import math
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from anm_mj.localisation.frame_to_images import FrameToImages
from anm_mj.localisation.key_images import Sums
from anm_mj.localisation.localisation_config import RegistrationConfig
from anm_mj.localisation.map_probe import MapProbe
from anm_mj.localisation.registration import PLANAR, Prior, RegistrationProblem, inside_border, register
from anm_mj.localisation.registration_starts import displacement_search, register_displaced, register_from_several
from anm_mj.mapping.alignment import AlignSettings, FramePoints, NormalEquations

RIGHT_M, FALSE_M = 0.0, 0.1
COUNT = 60
CONFIG = RegistrationConfig(field_deviation_m=0.01, color_deviation=0.0)


def frame() -> FramePoints:
    rng = np.random.default_rng(0)
    camera = rng.random((COUNT, 3)).astype(np.float32)
    return FramePoints(camera, camera, np.zeros(COUNT, np.float32), np.ones(COUNT, np.float32))


def align(points: FramePoints, T_world_camera: np.ndarray, settings: AlignSettings) -> NormalEquations:
    """All points lie off by the distance along x to the nearer minimum; in the false one a third of them never fits."""
    x = float(T_world_camera[0, 3])
    is_false = abs(x - FALSE_M) < abs(x - RIGHT_M)
    distance = np.full(len(points), x - (FALSE_M if is_false else RIGHT_M))
    if is_false:
        distance[::3] = 0.5
    square = (distance / settings.field_deviation_m) ** 2
    share = settings.kernel**2 / (settings.kernel**2 + square)
    weight = share**2 / settings.field_deviation_m**2 * (np.abs(distance) < 0.4)
    row = np.eye(6)[0]
    hessian = np.stack((np.outer(row, row) * weight.sum(), np.zeros((6, 6))))
    gradient = np.stack((row * float(weight @ distance), np.zeros(6)))
    facts = np.array([[float(share @ square), float((share**2).sum()), len(points)], [0.0, 0.0, 0.0]])
    return NormalEquations(hessian, gradient, facts)


class FakeMap(MapProbe):
    """A map that knows all places; the field and the poses at odds with it are given."""

    def __init__(self, align, contradicted=lambda _points, _T: 0.0) -> None:
        self.align, self.contradicted = align, contradicted

    def known(self, points_m: np.ndarray) -> np.ndarray:
        return np.ones(len(points_m), bool)


def before_the_false_minimum(**settings) -> RegistrationProblem:
    T = np.eye(4)
    T[0, 3] = FALSE_M - 0.02
    prior = Prior(T, np.diag([0.05**2, 0.01**2, 0.01**2]), PLANAR)
    return RegistrationProblem(frame(), prior, FakeMap(align), replace(CONFIG, **settings))


def test_a_false_minimum_is_left() -> None:
    problem = before_the_false_minimum()
    first = register(problem)
    assert abs(first.T_world_camera[0, 3] - FALSE_M) < 0.01
    best = register_from_several(problem, np.random.default_rng(1), first)
    assert abs(best.T_world_camera[0, 3] - RIGHT_M) < 0.01
    assert best.mean_cost < first.mean_cost


def test_a_pose_that_the_map_contradicts_is_not_taken() -> None:
    def contradicted(_points: FramePoints, T_world_camera: np.ndarray) -> float:
        return 1.0 if abs(T_world_camera[0, 3] - RIGHT_M) < 0.05 else 0.0

    problem = replace(before_the_false_minimum(), probe=FakeMap(align, contradicted))
    first = register(problem)
    assert register_from_several(problem, np.random.default_rng(1), first) is first


@pytest.mark.parametrize(("agreeing", "most_prior", "ends_early"), [(2, 1e6, True), (13, 1e6, False), (2, 1e-6, False)])
def test_the_search_ends_where_starts_agree_about_a_place_that_can_be_believed(
    agreeing, most_prior, ends_early
) -> None:
    problem = before_the_false_minimum(retry_starts=12, retry_agreeing=agreeing, most_prior=most_prior)
    rng = Mock(np.random.Generator, wraps=np.random.default_rng(1))

    register_from_several(problem, rng, register(problem))

    assert (rng.standard_normal.call_count < 12) is ends_early


def test_a_jump_is_not_taken() -> None:
    T = np.eye(4)
    T[0, 3] = FALSE_M
    # The better place is ten standard deviations away.
    prior = Prior(T, np.diag([0.01**2, 0.01**2, 0.01**2]), PLANAR)
    problem = replace(before_the_false_minimum(), prior=prior)
    first = register(problem)
    rng = np.random.default_rng
    wide = replace(CONFIG, retry_deviations=8.0, information=5.0)
    assert register_from_several(replace(problem, config=wide), rng(1), first) is first
    far = register_from_several(replace(problem, config=replace(wide, most_prior=1e6)), rng(1), first)
    assert abs(far.T_world_camera[0, 3] - RIGHT_M) < 0.02


class NarrowPicture(FrameToImages):
    """An image before a wall along y: its grey values lead to the right place from 3 mm away, its depth to x alone."""

    has_gray = True

    def __init__(self) -> None:
        pass

    def __len__(self) -> int:
        return 3000

    def __call__(self, T_world_camera: np.ndarray, kernel: float, coarse: bool) -> Sums:
        x, y = T_world_camera[:2, 3].tolist()
        # At a coarser resolution nothing is left of it.
        near = 0.0 if coarse else math.exp(-0.5 * (y / 0.003) ** 2)
        hessian, gradient = np.zeros((6, 6)), np.zeros(6)
        hessian[0, 0], hessian[1, 1] = 1e8, 1e7 * near + 1e3
        gradient[0], gradient[1] = 1e8 * x, 1e7 * near * y
        gray = 1.0 - near
        return Sums(hessian, gradient, 3000.0 * gray, 3000.0, gray)

    def every(self, step: int) -> "NarrowPicture":
        return self

    def subsample(self, num_points: int) -> "NarrowPicture":
        return self


def silent(points: FramePoints, T_world_camera: np.ndarray, settings: AlignSettings) -> NormalEquations:
    """A field that knows nothing of the place."""
    return NormalEquations(np.zeros((2, 6, 6)), np.zeros((2, 6)), np.zeros((2, 3)))


def test_a_displacement_before_a_near_wall_is_looked_for() -> None:
    T = np.eye(4)
    T[1, 3] = 0.03
    prior = Prior(T, np.diag([0.02, 0.02, 0.001]) ** 2, PLANAR)
    picture = NarrowPicture()
    problem = RegistrationProblem(frame(), prior, FakeMap(silent), CONFIG, picture)
    first = register(problem)
    assert abs(first.T_world_camera[1, 3]) > 0.02
    found = register_displaced(problem, first)
    assert abs(found.T_world_camera[1, 3]) < 0.004
    assert abs(found.T_world_camera[0, 3]) < 0.001


def test_a_displacement_that_is_known_is_not_looked_for() -> None:
    vague = Prior(np.eye(4), np.diag([0.02, 0.02, 0.001]) ** 2, PLANAR)
    problem = RegistrationProblem(frame(), vague, FakeMap(silent), CONFIG, NarrowPicture())
    assert displacement_search(problem, np.eye(4)) is not None
    sure = Prior(np.eye(4), np.diag([0.02, 0.002, 0.001]) ** 2, PLANAR)
    assert displacement_search(replace(problem, prior=sure), np.eye(4)) is None
    far = replace(frame(), camera_m=10.0 * frame().camera_m)
    assert displacement_search(replace(problem, points=far), np.eye(4)) is None
    assert displacement_search(replace(problem, extra=None), np.eye(4)) is None


def test_a_search_leaves_out_places_that_slide_out_of_view() -> None:
    class Edge(NarrowPicture):
        """Far aside hardly a point is left, and these fit by chance."""

        def __call__(self, T_world_camera: np.ndarray, kernel: float, coarse: bool) -> Sums:
            sums = super().__call__(T_world_camera, kernel, coarse)
            is_aside = abs(T_world_camera[1, 3]) > 0.04
            return sums._replace(num_points=100.0, mean_gray_cost=-1.0) if is_aside else sums

    prior = Prior(np.eye(4), np.diag([0.02, 0.02, 0.001]) ** 2, PLANAR)
    problem = RegistrationProblem(frame(), prior, FakeMap(silent), CONFIG, Edge())
    found = displacement_search(problem, np.eye(4))
    assert found is not None
    assert abs(found[1, 3]) < 0.004


class HalfWall(MapProbe):
    """A plain wall at z = 1, of which x < 0 was observed: in the last decimetre the field bends towards the camera."""

    def __init__(self) -> None:
        pass

    def known(self, points_m: np.ndarray) -> np.ndarray:
        return points_m[:, 0] < 0.0

    def align(self, points: FramePoints, T_world_camera: np.ndarray, settings: AlignSettings) -> NormalEquations:
        x, z = (points.camera_m + T_world_camera[:3, 3])[:, (0, 2)].T
        over = np.maximum(x + 0.1, 0.0)
        rows = np.zeros((len(x), 6))
        rows[:, 0], rows[:, 2] = 2.0 * over, 1.0
        distance = z - 1.0 + over**2
        weight = points.trust / settings.field_deviation_m**2
        hessian = np.stack((rows.T @ (rows * weight[:, None]), np.zeros((6, 6))))
        gradient = np.stack((rows.T @ (weight * distance), np.zeros(6)))
        count = float(points.trust.sum())
        return NormalEquations(hessian, gradient, np.array([[0.0, count, count], [0.0, 0.0, 0.0]]))


def wall(*, left_m: float, right_m: float) -> FramePoints:
    x, y = (each.ravel() for each in np.meshgrid(np.linspace(left_m, right_m, 40), np.linspace(-0.4, 0.4, 20)))
    camera = np.stack((x, y, np.ones(len(x))), axis=1).astype(np.float32)
    return FramePoints(camera, camera, np.zeros(len(x), np.float32), np.ones(len(x), np.float32))


def test_the_border_of_the_map_does_not_draw_along_a_plain_wall() -> None:
    # Along the wall, x, nothing tells where the camera is.
    prior = Prior(np.eye(4), np.diag([0.02**2, 1e-12, 1e-12]), PLANAR)
    config = replace(CONFIG, border_m=0.15)
    drawn, found = (
        register(RegistrationProblem(wall(left_m=-0.5, right_m=0.2), prior, HalfWall(), each))
        for each in (CONFIG, config)
    )
    assert abs(drawn.T_world_camera[0, 3]) > 0.01
    assert abs(found.T_world_camera[0, 3]) < 1e-3
    assert math.sqrt(found.covariance[0, 0]) == pytest.approx(0.02, rel=0.05)
    assert found.known == pytest.approx(5 / 7, abs=0.03)
    assert found.inliers == pytest.approx(1.0)


def test_where_all_that_is_known_lies_at_the_border_all_of_it_counts() -> None:
    points = wall(left_m=-0.1, right_m=0.2).camera_m
    known = points[:, 0] < 0.0
    assert (inside_border(known, points, 0.15) == known).all()
    assert inside_border(np.ones(len(points), bool), points, 0.15).all()
