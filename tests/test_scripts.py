"""Runs the numbered scripts, which are the first programs that a user opens, as they stand but for fewer steps."""

import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import anm_mj
from anm_mj import api

SCRIPTS = Path(__file__).resolve().parents[1] / "scripts"
NUMBERED = sorted(SCRIPTS.glob("0*.py"))
QUICK = ["image_px=32", "mapping.schedule.first_iterations=5", "mapping.schedule.final_iterations=0"]


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """A function that runs a script in an empty folder, with small images and little training; what it printed."""

    def explore_scene(scene, **options):
        return api.explore_scene(scene, settings=QUICK, **options)

    def run_script(name, *words):
        monkeypatch.setattr(sys, "argv", [name, *words])
        runpy.run_path(str(SCRIPTS / name), run_name="__main__")
        return capsys.readouterr().out

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(anm_mj, "explore_scene", explore_scene)
    return run_script


def test_scripts_are_short_and_numbered():
    assert [path.name[:3] for path in NUMBERED] == [f"{k:02d}_" for k in range(7)]
    for path in NUMBERED:
        assert len(path.read_text(encoding="utf-8").splitlines()) < 80, path.name


def test_explore_home(run):
    said = run("00_explore_home.py", "--scene", "room", "--steps", "6")
    assert "ended by BUDGET after 6 steps" in said
    assert "of what the robot can see at all" in said


@pytest.mark.slow
def test_your_scene(run):
    said = run("01_your_scene.py", "--steps", "6")
    assert "96 triangles" in said
    assert "rooms: 2" in said
    assert "the robot fits" in said
    assert "seen to 5 cm" in said


@pytest.mark.slow
def test_your_robot(run):
    said = run("02_your_robot.py", "--scene", "room", "--steps", "6")
    assert "wheels" in said
    assert Path("my_robot_check.png").is_file()
    assert "seen to 5 cm" in said


@pytest.mark.slow
def test_your_policy(run):
    said = run("03_your_policy.py", "--scene", "room", "--steps", "6")
    assert "__main__:WallFollower" in said
    assert "gvg" in said


@pytest.mark.slow
def test_use_the_map(run):
    made = api.explore_scene("room", steps=6, settings=QUICK)
    run("04_use_the_map.py", "--run", str(made.folder), "--out", ".")
    assert np.ptp(np.asarray(Image.open("view.png"))) > 0
    assert Path("slice.png").is_file()
    assert Path("map.glb").stat().st_size > 1000


@pytest.mark.slow
def test_compare_policies(run):
    said = run("05_compare_policies.py", "--scenes", "room", "--starts", "1", "--steps", "6")
    assert "2/2" in said
    assert "of what can be seen, mean of 1 runs" in said
    assert Path("bench/comparison/table.md").is_file()


@pytest.mark.slow
def test_learn(tmp_path):
    # A process of its own: its workers import the script.
    words = ["--decisions", "512", "--steps", "12", "--starts", "2", "--out", str(tmp_path / "learned")]
    command = [sys.executable, str(SCRIPTS / "06_learn.py"), *words]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, timeout=250)
    assert done.returncode == 0, done.stderr
    assert "the agent has +0.0 +- 0.0 (paired)" in done.stdout
    assert {path.name for path in (tmp_path / "learned").iterdir()} == {
        "agent.zip",
        "learning.monitor.csv",
        "learning.png",
    }


@pytest.mark.parametrize("name", ["novel_views.py", "track_sequence.py", "map_quality.py", "noise_figure.py"])
def test_a_script_says_in_one_sentence_what_is_wrong(name, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [name, str(tmp_path / "nothing")])
    with pytest.raises(SystemExit) as end:
        runpy.run_path(str(SCRIPTS / name), run_name="__main__")
    assert end.value.code == 2
    said = capsys.readouterr().err
    assert "nothing" in said
    assert said.count("\n") == 1


def test_a_recording_of_no_scene_leaves_no_folder(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["record_sequence.py", "no_scene", str(tmp_path / "walk")])
    with pytest.raises(SystemExit):
        runpy.run_path(str(SCRIPTS / "record_sequence.py"), run_name="__main__")
    assert "no_scene" in capsys.readouterr().err
    assert not (tmp_path / "walk").exists()
