"""The committed house of seven rooms: an asset that a robot can live in."""

from pathlib import Path

import numpy as np
import pytest

from anm_mj.scene.folder import Scene, load_scene
from anm_mj.scene.navigable import is_clear, navigable_area
from anm_mj.types import DEFAULT_FOOTPRINT

_ROOMS_M = {
    "living room": ((0.0, 0.0), (5.84, 4.14)),
    "kitchen": ((5.96, 0.0), (11.0, 4.14)),
    "hall": ((3.96, 4.26), (11.0, 5.44)),
    "bedroom": ((0.0, 4.26), (3.84, 8.6)),
    "bathroom": ((3.96, 5.56), (5.94, 8.6)),
    "study": ((6.06, 5.56), (8.34, 8.6)),
    "child's room": ((8.46, 5.56), (11.0, 8.6)),
}
"""Lowest and highest x, y of each room's floor [m]."""
_WINDOW_DEPTH_M, _CEILING_M = 0.14, 2.6


@pytest.fixture(scope="module")
def home() -> Scene:
    return load_scene(Path(__file__).resolve().parents[2] / "scenes" / "home")


def test_home_has_its_seven_rooms(home):
    assert home.rooms == len(_ROOMS_M)
    assert home.has_ceiling
    assert 15_000 <= home.num_triangles <= 40_000


def test_home_is_small_on_disk(home):
    assert sum(file.stat().st_size for file in home.folder.rglob("*") if file.is_file()) < 6_000_000


def test_the_robot_reaches_every_room(home):
    vertices, faces = home.triangles()
    places = navigable_area(vertices[faces], DEFAULT_FOOTPRINT).places(1)

    for name, (low_m, high_m) in _ROOMS_M.items():
        inside = (places > low_m).all(axis=1) & (places < high_m).all(axis=1)
        assert inside.sum() * 0.025**2 > 1.0, name


def test_starts_are_clear(home):
    assert len(home.starts) == 3
    assert all(is_clear(home, start, DEFAULT_FOOTPRINT) for start in home.starts)


def test_home_has_no_outside(home):
    """Nothing lies beyond the window panes, above the ceiling or below the floor."""
    low, high = (np.array(list(_ROOMS_M.values()))[:, side] for side in (0, 1))

    assert (home.bounds_m[0, :2] >= low.min(axis=0) - _WINDOW_DEPTH_M - 1e-3).all()
    assert (home.bounds_m[1, :2] <= high.max(axis=0) + _WINDOW_DEPTH_M + 1e-3).all()
    assert home.bounds_m[0, 2] > -0.005
    assert home.bounds_m[1, 2] == pytest.approx(_CEILING_M)
