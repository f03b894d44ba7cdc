"""The compass of walls: what it learns, what it says of a heading, and what it leaves unsaid."""

import math
from dataclasses import replace

import numpy as np
import pytest

from anm_mj.localisation.compass import WallCompass
from anm_mj.localisation.localisation_config import CompassConfig
from anm_mj.localisation.registration import FREE, PLANAR, Prior, RegistrationProblem, register
from anm_mj.localisation.se3 import moved_camera
from anm_mj.localisation.wall_directions import Headings
from anm_mj.mapping.alignment import NormalEquations
from anm_mj.types import Observation
from tests.localisation.test_registration import CONFIG, FakeMap, frame
from tests.mapping.ray_room import Room

VAGUE = np.diag([0.02, 0.02, 0.02]) ** 2


def turned(observation: Observation, angle_rad: float) -> np.ndarray:
    return moved_camera(observation.T_world_camera, np.array([0.0, 0.0, 0.0, 0.0, 0.0, angle_rad]))


def taught(frames: list[Observation]) -> WallCompass:
    """A compass that has seen some frames at their true poses."""
    compass = WallCompass(CompassConfig(), PLANAR)
    for each in frames:
        compass.look(each, Prior(each.T_world_camera, VAGUE, PLANAR), 0.0)
        compass.learn(each.T_world_camera, 1e-4)
    return compass


def told(compass: WallCompass, observation: Observation, off_rad: float, basis: np.ndarray = PLANAR) -> Headings | None:
    covariance = VAGUE if basis is PLANAR else np.eye(6) * 4e-4
    return compass.look(observation, Prior(turned(observation, off_rad), covariance, basis), 0.0).headings


@pytest.mark.parametrize("off_deg", [-3.0, 0.5, 4.0])
def test_the_heading_is_told_by_walls_that_were_seen_from_elsewhere(room: Room, off_deg: float) -> None:
    compass = taught(room.turn(1.5, 1.5, 12, size=128))
    headings = told(compass, room.observe(1.0, 2.0, 0.3, size=128), math.radians(off_deg))
    assert headings is not None
    assert min(abs(turn + math.radians(off_deg)) for turn in headings.turns_rad) < math.radians(0.02)


def test_nothing_is_told_before_a_wall_was_seen(room: Room) -> None:
    assert told(WallCompass(CompassConfig(), PLANAR), room.observe(1.0, 2.0, 0.3, size=128), 0.0) is None


def test_nothing_is_told_of_a_heading_that_the_prior_excludes(room: Room) -> None:
    compass = taught(room.turn(1.5, 1.5, 12, size=128))
    assert told(compass, room.observe(1.0, 2.0, 0.3, size=128), math.radians(20.0)) is None


def test_it_is_off_for_cameras_in_the_hand_and_by_its_setting(room: Room) -> None:
    seen = room.observe(1.0, 2.0, 0.3, size=128)
    for compass, basis in (
        (WallCompass(CompassConfig(), FREE), FREE),
        (WallCompass(CompassConfig(is_on=False), PLANAR), PLANAR),
    ):
        told(compass, seen, 0.0, basis)
        compass.learn(seen.T_world_camera, 1e-4)
        assert told(compass, seen, 0.0, basis) is None


def test_a_rare_direction_beside_a_frequent_one_is_not_believed(room: Room) -> None:
    frames = room.turn(1.5, 1.5, 12, size=128)
    compass = taught(frames)
    # A cupboard that stands two degrees askew is seen thrice.
    askew = room.observe(1.0, 2.0, 0.3, size=128)
    for _ in range(3):
        compass.look(askew, Prior(askew.T_world_camera, VAGUE, PLANAR), 0.0)
        compass.learn(turned(askew, math.radians(2.0)), 1e-4)
    headings = told(compass, askew, math.radians(2.0))
    assert headings is not None
    assert all(abs(turn + math.radians(2.0)) < math.radians(0.1) for turn in headings.turns_rad)


def test_walls_that_are_not_quite_parallel_count_for_less(room: Room) -> None:
    frames = room.turn(1.5, 1.5, 12, size=128)
    straight, crooked = taught(frames), taught(frames)
    for k in range(60):
        seen = frames[k % len(frames)]
        crooked.look(seen, Prior(seen.T_world_camera, VAGUE, PLANAR), 0.0)
        crooked.learn(turned(seen, math.radians(0.25 * (-1) ** k)), 1e-4)
    seen = room.observe(1.0, 2.0, 0.3, size=128)
    sharp, vague = told(straight, seen, 0.0), told(crooked, seen, 0.0)
    assert sharp is not None
    assert vague is not None
    assert min(vague.deviations_rad) > 3.0 * min(sharp.deviations_rad)


def test_a_registration_turns_to_the_heading_unless_it_is_an_outlier() -> None:
    points, T = frame(), np.eye(4)

    def blind(points, T_world_camera, settings) -> NormalEquations:
        """A field that holds the heading to one degree, and nothing else."""
        off = math.atan2(T_world_camera[1, 0], T_world_camera[0, 0])
        information = 10.0 / math.radians(1.0) ** 2
        hessian = np.zeros((2, 6, 6))
        hessian[0, 5, 5] = information
        gradient = np.zeros((2, 6))
        gradient[0, 5] = information * off
        return NormalEquations(hessian, gradient, np.zeros((2, 3)))

    prior = Prior(T, np.diag([0.01, 0.01, 1.0]) ** 2, PLANAR)
    for turn_deg, expected_deg in ((0.2, 0.2), (30.0, 0.0)):
        headings = Headings(T, (math.radians(turn_deg),), (math.radians(0.05),), (10.0, 3.0))
        found = register(RegistrationProblem(points, replace(prior, headings=headings), FakeMap(blind), CONFIG))
        yaw = math.degrees(math.atan2(found.T_world_camera[1, 0], found.T_world_camera[0, 0]))
        assert yaw == pytest.approx(expected_deg, abs=0.03)
