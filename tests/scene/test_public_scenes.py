"""The scenes that lie beside the repository, against what is known of them; skipped where they are absent."""

import json
import math

import numpy as np
import pytest

from anm_mj.scene.importing.import_scene import import_scene
from anm_mj.scene.navigable import is_clear, scene_area
from anm_mj.types import Footprint, Pose2

FOOTPRINT = Footprint(radius_m=0.18, z_min_m=0.06, z_max_m=1.35)


@pytest.mark.parametrize(
    "name",
    [
        "white_room",
        "small_apartment",
        pytest.param("aws_small_house", marks=pytest.mark.slow),
        "rmf_office",
        pytest.param("aws_hospital", marks=pytest.mark.slow),
    ],
)
def test_a_known_scene_comes_out_as_it_is_known(public_scenes, tmp_path, name):
    known = {entry["name"]: entry for entry in json.loads((public_scenes / "scenes.json").read_text())}[name]
    scene = import_scene(public_scenes / known["file"], tmp_path / name)
    assert np.allclose(scene.bounds_m, known["bounds"], atol=2e-3)
    assert scene.num_triangles == pytest.approx(known["triangles"], rel=0.001)
    assert scene.has_ceiling == known["has_ceiling"]

    area = scene_area(scene, FOOTPRINT)
    assert area.area_m2 == pytest.approx(known["navigable_area_m2"], rel=0.03)
    for x, y in known["starts"]:
        assert is_clear(scene, Pose2(x, y, 0.0), FOOTPRINT)
        assert math.dist(area.nearest(np.array([x, y])), (x, y)) < 0.03
    assert len(scene.starts) >= 3
    assert all(is_clear(scene, start, FOOTPRINT) for start in scene.starts)
