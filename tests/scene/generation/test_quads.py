"""Bodies made of quads."""

import numpy as np
import pytest

from anm_mj.scene.generation.quads import Quads, ball, box, cushion, cylinder, lathe, strut
from anm_mj.scene.generation.textures import plain

_GREY = plain((0.5, 0.5, 0.5))


def _volume(surface: Quads) -> float:
    """Signed volume by the divergence theorem; positive when a closed surface faces outward."""
    p = surface.corners_m
    triangles = np.concatenate([p[:, [0, 1, 2]], p[:, [0, 2, 3]]])
    return float(np.einsum("ij,ij->", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])) / 6.0)


@pytest.mark.parametrize(
    ("body", "volume"),
    [
        (box((0.0, 0.0, 0.0), (1.0, 2.0, 3.0), _GREY), 6.0),
        (lathe([(0.0, 0.0), (1.0, 0.0), (1.0, 2.0), (0.0, 2.0)], _GREY, 64), 2.0 * np.pi),
        (ball(1.0, _GREY, 64), 4.0 / 3.0 * np.pi),
        (strut((0.0, 0.0, 0.0), (0.0, 1.0, 1.0), 0.5, _GREY, 64), 0.25 * np.pi * np.sqrt(2.0)),
        (cushion((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.001, _GREY), 1.0),
        (box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), _GREY).tilted(30.0).placed(3.0, -2.0, 50.0, 1.0), 1.0),
    ],
)
def test_bodies_are_closed_and_face_outward(body: Quads, volume: float):
    assert _volume(body) == pytest.approx(volume, rel=0.01)


def test_cylinder_has_no_bottom():
    normals = cylinder(0.1, 0.0, 1.0, _GREY).normals

    assert (normals[:, 2] > -0.5).all()
    assert (normals[:, 2] > 0.5).any()


def test_box_skips_the_named_faces():
    normals = box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), _GREY, skip="-z +y").normals

    assert not (normals @ (0.0, 0.0, -1.0) > 0.9).any()
    assert not (normals @ (0.0, 1.0, 0.0) > 0.9).any()
    assert len(normals) == 4
