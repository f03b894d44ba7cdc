import numpy as np
import trimesh

from anm_mj.scene.importing.shading import DARKEST, shaded
from anm_mj.scene.submesh import Submesh


def _box(**more) -> Submesh:
    box = trimesh.creation.box((4.0, 3.0, 2.5))
    return Submesh("box", box.vertices, box.faces.astype(np.int32), (0.5, 0.8, 1.0), **more)


def test_sides_that_meet_in_a_corner_differ_in_brightness():
    parts = shaded([_box(part="house/walls")])
    assert sum(len(part.faces) for part in parts) == 12
    brightness = {}
    for part in parts:
        np.testing.assert_allclose(np.array(part.rgb) / part.rgb[2], (0.5, 0.8, 1.0))
        assert part.part == "house/walls"
        corners = part.vertices_m[part.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        for side in np.unique((normals / np.linalg.norm(normals, axis=1, keepdims=True)).round(), axis=0):
            brightness[tuple(side.astype(int).tolist())] = part.rgb[2]
    assert len(brightness) == 6
    assert np.diff(sorted(brightness.values())).min() > 0.055
    assert DARKEST <= min(brightness.values()) < max(brightness.values()) <= 1.0


def test_what_has_light_in_its_texture_stays_as_it_is():
    scanned = [_box(uv=np.zeros((8, 2)), texture=np.zeros((2, 2, 3), np.uint8)), _box()]
    assert shaded(scanned) is scanned
