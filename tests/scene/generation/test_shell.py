"""Floors, ceilings and walls of generated rooms."""

import numpy as np
import pytest

from anm_mj.scene.generation.furnish import furnish
from anm_mj.scene.generation.layout import plan_building
from anm_mj.scene.generation.shell import Surface, room_shell


@pytest.mark.parametrize("kind", ["apartment", "office"])
def test_a_shell_faces_the_inside_of_its_room(kind):
    """From the middle of the room no wall, floor or ceiling is seen from behind."""
    building = plan_building(6, 1, kind)
    for room in furnish(building, 1, furniture=False):
        shell = Surface(room_shell(building, room, 1)).quads
        p = shell.corners_m
        area_m2 = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 3] - p[:, 0]), axis=1)
        to_middle = np.array([room.room.floor.centroid.x, room.room.floor.centroid.y, 1.3]) - p.mean(axis=1)
        facing = (shell.normals * to_middle).sum(axis=1)

        assert (area_m2 > 0.5).sum() >= 6
        assert (facing[area_m2 > 0.5] > 0).all(), room.room.name
