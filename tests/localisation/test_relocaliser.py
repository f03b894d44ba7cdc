"""Where a lost camera is expected, and what it is looked for by."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from anm_mj.localisation import relocaliser
from anm_mj.localisation.localisation_config import LocalisationConfig
from anm_mj.localisation.map_probe import MapProbe
from anm_mj.localisation.registration import FREE, PLANAR
from anm_mj.localisation.relocaliser import Relocaliser
from anm_mj.mapping.alignment import FramePoints
from anm_mj.mapping.neural_map import NeuralMap
from tests.mapping.ray_room import camera_pose

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


def test_a_camera_that_is_looked_for_at_many_heights_keeps_the_distances_of_the_map_once(
    trained_map: NeuralMap,
) -> None:
    finder = Relocaliser(CONFIG, FREE, MapProbe(trained_map))
    grids = [finder._grid(height_m) for height_m in (0.4, 1.2, 1.6)]
    assert all(grid.distance_m is grids[0].distance_m for grid in grids)
    finder.restart()
    assert finder._grid(0.4).distance_m is not grids[0].distance_m


def test_what_lies_beyond_the_margin_of_the_map_takes_no_part(
    trained_map: NeuralMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the edges of a view of 130 degrees a depth of 5 m is 12 m away."""
    searched = []
    monkeypatch.setattr(relocaliser, "search", lambda points, *_: searched.append(points) or [])
    x = np.repeat(np.tan(np.radians([0.0, 50.0, 65.0])), 100) * 5.0
    camera_m = np.column_stack((x, np.zeros(300), np.full(300, 5.0))).astype(np.float32)
    ones = np.ones(300, np.float32)
    points = FramePoints(camera_m, np.zeros((300, 3), np.float32), ones, ones)
    finder = Relocaliser(CONFIG, PLANAR, MapProbe(trained_map))
    finder.look(points, (camera_pose(0.0, 0.0, 1.2, 0.0),), np.random.default_rng(0))
    grid, rows = finder._grid(1.2), searched[0].camera_m
    assert len(rows) == 200
    # From any place in the map it ends within the grid, whose rows lie one behind the other in memory.
    margin = np.argwhere(grid.open).min(axis=0).min() * grid.cell_m
    assert np.linalg.norm(rows, axis=1).max() <= margin
