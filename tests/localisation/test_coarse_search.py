"""Heights and tilts that a lost camera may have, and the grid that its places are scored by."""

import math

import numpy as np

from anm_mj.localisation.coarse_search import distance_grid, distinct_tilts
from anm_mj.localisation.localisation_config import RelocalisationConfig
from anm_mj.mapping.neural_map import NeuralMap
from tests.mapping.ray_room import camera_pose

CONFIG = RelocalisationConfig()


def tilted(height_m: float, pitch_rad: float, yaw_rad: float = 0.0) -> np.ndarray:
    """A camera somewhere that looks down by an angle."""
    T = camera_pose(1.0, 2.0, height_m, yaw_rad)
    c, s = math.cos(pitch_rad), math.sin(pitch_rad)
    T[:3, :3] = T[:3, :3] @ np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    return T


def test_tilts_that_are_alike_are_one_and_frequent_ones_come_first() -> None:
    once, often, higher = tilted(1.0, 0.0), tilted(1.0, 0.3, 1.0), tilted(1.5, 0.0)
    poses = [once, often, higher, tilted(1.05, 0.35, -2.0), tilted(1.52, 0.0, 3.0), often]
    found = distinct_tilts(poses)
    np.testing.assert_allclose([T[2, 3] for T in found], (1.0, 1.5, 1.0))
    np.testing.assert_allclose([-T[2, 2] for T in found], (math.sin(0.3), 0.0, 0.0), atol=1e-9)
    assert all(np.allclose(T[:2, 3], 0.0) for T in found)


def test_of_equally_frequent_tilts_the_earliest_comes_first() -> None:
    found = distinct_tilts([tilted(2.0, 0.0), tilted(1.0, 0.0), tilted(1.5, 0.0)])
    np.testing.assert_allclose([T[2, 3] for T in found], (2.0, 1.0, 1.5))


def test_there_may_be_no_tilt() -> None:
    assert distinct_tilts([]) == []


def test_grids_of_several_heights_share_their_distances(trained_map: NeuralMap) -> None:
    grid = trained_map.occupancy.by_depth.grid
    one = distance_grid(grid, 1.2, 1.2, 10.0, CONFIG)
    alone = distance_grid(grid, 0.4, 0.4, 10.0, CONFIG)
    other = distance_grid(grid, 0.4, 0.4, 10.0, CONFIG, one)
    assert other.distance_m is one.distance_m
    np.testing.assert_array_equal(other.distance_m, alone.distance_m)
    np.testing.assert_array_equal(other.open, alone.open)
    np.testing.assert_array_equal(other.origin_m, alone.origin_m)
    assert (other.open != one.open).any()
