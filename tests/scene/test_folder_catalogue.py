"""Scenes that were made anywhere are listed and can be named from everywhere."""

import shutil
import tempfile
from pathlib import Path

import pytest

from anm_mj.cli.main import main
from anm_mj.errors import SceneError
from anm_mj.scene.folder import INDEX, list_scenes, load_scene, remember_folder, remembered_folders

_ROOM = Path(__file__).resolve().parents[2] / "scenes" / "room"


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to keep scenes in, which is not the system's temporary one, and a user's folder beside it."""
    monkeypatch.setenv("ANM_MJ_SCENES", str(tmp_path / "user"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "desk").mkdir()
    return tmp_path / "desk"


def test_a_scene_made_elsewhere_is_found_by_name(place: Path):
    folder = shutil.copytree(_ROOM, place / "attic")
    remember_folder(folder)
    remember_folder(folder)

    assert remembered_folders() == [folder]
    assert load_scene("attic").folder == folder
    assert folder in [scene.folder for scene in list_scenes()]


def test_scenes_on_a_disk_that_is_not_mounted_are_kept(place: Path):
    away, other = shutil.copytree(_ROOM, place / "attic"), shutil.copytree(_ROOM, place / "cellar")
    remember_folder(away)
    away.rename(place / "unmounted")
    remember_folder(other)
    assert remembered_folders() == [other]
    (place / "unmounted").rename(away)
    assert remembered_folders() == [away, other]


def test_a_scene_that_is_gone_is_forgotten(place: Path):
    folder = shutil.copytree(_ROOM, place / "attic")
    remember_folder(folder)
    shutil.rmtree(folder)

    assert remembered_folders() == []
    with pytest.raises(SceneError, match="no scene 'attic'"):
        load_scene("attic")


def test_a_remembered_scene_does_not_hide_one_of_the_project(place: Path):
    remember_folder(shutil.copytree(_ROOM, place / "office"))

    assert load_scene("office").rooms == 10


def test_what_lies_in_the_temporary_folder_is_not_remembered(place: Path):
    remember_folder(shutil.copytree(_ROOM, place.parent / "temporary" / "attic"))

    assert remembered_folders() == []


def test_a_user_folder_that_cannot_be_written_is_no_error(place: Path):
    (place.parent / "user").write_text("")
    remember_folder(shutil.copytree(_ROOM, place / "attic"))

    assert remembered_folders() == []


def test_a_spoilt_index_is_no_error(place: Path):
    (place.parent / "user").mkdir()
    (place.parent / "user" / INDEX).write_bytes(b"\xff\xfe\n")

    assert remembered_folders() == []


def test_a_scene_beside_the_user_is_listed(place: Path, monkeypatch: pytest.MonkeyPatch):
    folder = shutil.copytree(_ROOM, place / "cellar")
    monkeypatch.chdir(place)

    assert folder in [scene.folder.resolve() for scene in list_scenes()]


def test_the_list_shows_the_name_that_a_scene_is_found_by(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    folder = shutil.copytree(_ROOM, place / "attic[1]")
    toml = folder / "scene.toml"
    toml.write_text(toml.read_text().replace('name = "room"', 'name = "My attic"'))
    monkeypatch.chdir(place)
    assert main(["scene", "list"]) == 0

    said = capsys.readouterr().out
    assert "attic[1]" in said
    assert "My attic" not in said
    assert load_scene("attic[1]").name == "My attic"


def test_the_command_generates_a_scene_that_can_then_be_named(place: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["scene", "generate", str(place / "den"), "--rooms", "1", "--seed", "2"]) == 0

    assert "den: 1 room, " in capsys.readouterr().out
    assert load_scene("den").source == "anm-mj scene generate --rooms 1 --seed 2 --kind apartment"


def test_a_new_scene_with_the_name_of_a_builtin_one_says_which_one_the_name_means(
    place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(place)
    words = ["--rooms", "1", "--seed", "2"]
    assert main(["scene", "generate", "sub/room", *words]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "The package has a scene room, too; here the name means " in said
    assert "here the name means room." not in said
    assert main(["scene", "generate", "room", *words]) == 0
    assert "The package has a scene room, too; here the name means room." in capsys.readouterr().out
    assert main(["scene", "generate", "den", *words]) == 0
    assert "The package" not in capsys.readouterr().out


def test_the_command_refuses_what_cannot_be_generated(place: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["scene", "generate", str(place / "den"), "--rooms", "1000"]) == 2
    assert "give 1 to 60" in " ".join(capsys.readouterr().err.split())
