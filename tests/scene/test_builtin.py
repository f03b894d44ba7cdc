"""The scenes that come with the project: small enough, of different size, and what the code makes."""

from pathlib import Path

import pytest

from anm_mj.errors import SceneError
from anm_mj.scene.builtin import OWN_SCENES, make_own_scene
from anm_mj.scene.folder import load_scene
from anm_mj.scene.navigable import DEFAULT_FOOTPRINT, is_clear

_SCENES = Path(__file__).resolve().parents[2] / "scenes"


@pytest.mark.parametrize("name", OWN_SCENES)
def test_every_own_scene_is_there_and_says_what_it_is(name):
    scene = load_scene(_SCENES / name)

    assert (scene.name, scene.licence) == (name, "MIT")
    assert scene.has_ceiling
    assert scene.budget_steps is not None
    assert len(scene.starts) >= 3
    assert all(is_clear(scene, start, DEFAULT_FOOTPRINT) for start in scene.starts)


def test_own_scenes_are_of_different_size_and_light_together():
    rooms = [load_scene(_SCENES / name).rooms for name in OWN_SCENES]
    size = sum(file.stat().st_size for file in _SCENES.rglob("*") if file.is_file())

    assert rooms == [1, 4, 7, 10, 24]
    assert size < 25_000_000


def test_nothing_else_lies_among_the_own_scenes():
    assert {folder.name for folder in _SCENES.iterdir()} == set(OWN_SCENES)


def test_the_committed_room_is_the_one_that_the_code_makes(tmp_path: Path):
    assert make_own_scene("room", tmp_path / "room").hash == load_scene(_SCENES / "room").hash


def test_an_unknown_scene_is_refused(tmp_path: Path):
    with pytest.raises(SceneError, match="give one of room, flat"):
        make_own_scene("castle", tmp_path / "castle")
