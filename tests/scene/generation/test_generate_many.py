"""Forty buildings of 2 to 40 rooms, no seed twice: every one is made, and the robot gets into every room."""

from pathlib import Path

import numpy as np
import pytest
import shapely

from anm_mj.scene.generation.generate_scene import generate_scene
from anm_mj.scene.generation.layout import plan_building
from anm_mj.scene.navigable import is_clear, navigable_area
from anm_mj.types import DEFAULT_FOOTPRINT


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("number", range(40))
def test_forty_buildings_can_be_lived_in(number: int, tmp_path: Path):
    rooms, seed, kind = round(2 + 38 * number / 39), 100 + number, ("apartment", "apartment", "office")[number % 3]
    scene = generate_scene(tmp_path / "made", rooms, seed, kind)
    vertices, faces = scene.triangles()
    places = navigable_area(vertices[faces], DEFAULT_FOOTPRINT).places(1)

    for room in plan_building(rooms, seed, kind).rooms:
        share = np.count_nonzero(shapely.contains_xy(room.floor, places)) * 0.025**2 / room.floor.area
        assert share > 0.15, room.name
    assert scene.rooms == rooms
    assert scene.has_ceiling
    assert all(is_clear(scene, start, DEFAULT_FOOTPRINT) for start in scene.starts)
