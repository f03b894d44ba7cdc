"""How many steps a run has, by each rule."""

import dataclasses

import numpy as np
import pytest

from anm_mj.scene.budget import default_steps
from anm_mj.scene.folder import Scene
from anm_mj.scene.submesh import Submesh
from anm_mj.scene.writer import SceneInfo, write_scene
from tests.scene.shapes import room


@pytest.fixture(scope="module")
def hall(tmp_path_factory) -> Scene:
    mesh = room(10.36, 5.36)
    part = Submesh("walls", mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32))
    return write_scene([part], SceneInfo("hall", "tests", "CC0"), tmp_path_factory.mktemp("budget") / "hall")


def test_without_a_word_the_floor_decides(hall):
    # A robot of 18 cm radius reaches 10 x 5 m.
    assert default_steps(hall) == default_steps(hall, "area") == 700


def test_a_scene_may_name_its_own(hall):
    named = dataclasses.replace(hall, budget_steps=321)
    assert (default_steps(named), default_steps(named, "area")) == (321, 700)


@pytest.mark.parametrize(("rooms", "steps"), [(None, 1000), (5, 1000), (6, 2000), (19, 2000), (20, 10_000)])
def test_the_rule_of_the_paper_counts_rooms(hall, rooms, steps):
    assert default_steps(dataclasses.replace(hall, rooms=rooms, budget_steps=321), "rooms") == steps
