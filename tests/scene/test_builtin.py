"""The scenes that come with the project: small, of different size, and what the generator makes."""

import subprocess
import sys
from pathlib import Path

import pytest

from anm_mj.scene.folder import load_scene
from anm_mj.scene.navigable import is_clear
from anm_mj.types import DEFAULT_FOOTPRINT

_ROOT = Path(__file__).resolve().parents[2]
_SCENES = _ROOT / "scenes"
_ROOMS = {"room": 1, "flat": 4, "home": 7, "office": 10, "residence": 24}


@pytest.mark.parametrize("name", _ROOMS)
def test_a_builtin_scene_is_complete(name):
    scene = load_scene(_SCENES / name)

    assert (scene.name, scene.licence, scene.rooms) == (name, "MIT", _ROOMS[name])
    assert scene.has_ceiling
    assert scene.budget_steps is not None
    assert len(scene.starts) >= 3
    assert all(is_clear(scene, start, DEFAULT_FOOTPRINT) for start in scene.starts)


def test_builtin_scenes_are_small_together():
    assert sum(file.stat().st_size for file in _SCENES.rglob("*") if file.is_file()) < 25_000_000


def test_nothing_else_lies_among_them():
    assert {folder.name for folder in _SCENES.iterdir()} == set(_ROOMS)


def _make(*words: str) -> subprocess.CompletedProcess[str]:
    script = _ROOT / "scripts" / "make_scenes.py"
    return subprocess.run([sys.executable, str(script), *words], capture_output=True, text=True)


def test_the_script_makes_the_committed_room(tmp_path: Path):
    assert _make("room", "--out", str(tmp_path)).returncode == 0
    assert load_scene(tmp_path / "room").hash == load_scene(_SCENES / "room").hash


def test_the_script_refuses_an_unknown_scene(tmp_path: Path):
    done = _make("castle", "--out", str(tmp_path))

    assert done.returncode != 0
    assert "give some of room, flat" in done.stderr
