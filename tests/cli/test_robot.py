"""``anm-mj robot check``: what it prints, draws and refuses."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from anm_mj.cli.main import main
from anm_mj.sim.drives.drive_trial import plain_fault

ROOT = Path(__file__).resolve().parents[2]
MODELS = ROOT / "tests" / "robot" / "models"


def test_a_skid_steered_robot(tmp_path, capsys):
    out = tmp_path / "four.png"
    robot = str(MODELS / "four_wheels.xml")
    assert main(["robot", "check", robot, "--set", "model.skid_steer=true", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    for words in (
        "skid steer, 18.4 kg",
        "left front_left_wheel, rear_left_wheel",
        "wheel radius 0.0950 m",
        "camera: front",
    ):
        assert words in said
    assert "90.0 of 90 deg" in said
    assert "times as far as without slip; --set model.track_scale=2." in said
    picture = np.asarray(Image.open(out).convert("RGB"))
    assert picture.shape[1] > 2.0 * picture.shape[0]
    assert ((picture[..., 0] > 150) & (picture[..., 1] < 120)).sum() > 500  # The footprint.


def test_wrong_robots_write_nothing(tmp_path, capsys):
    out = tmp_path / "no.png"
    assert main(["robot", "check", str(MODELS / "four_wheels.xml"), "--out", str(out)]) == 2
    assert "has 4 driven wheels" in capsys.readouterr().err
    assert main(["robot", "check", "nobody", "--out", str(out)]) == 2
    assert main(["robot", "check", str(MODELS / "planar.xml"), "--set", "model.keyframe=none", "--out", str(out)]) == 2
    assert not out.exists()


@pytest.mark.slow
def test_a_robot_that_tips_over(tmp_path, capsys):
    text = (ROOT / "tests" / "rover.xml").read_text()
    before = '<geom name="caster"'
    assert before in text
    robot = tmp_path / "tipping.xml"
    robot.write_text(text.replace(before, '<geom name="lid" contype="0" conaffinity="0"'))
    assert main(["robot", "check", str(robot), "--out", str(tmp_path / "tipping.png")]) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "so that the robot tips over; add a caster" in said


@pytest.mark.parametrize("option", ['timestep="1e-9"', 'gravity="0 0 1e30"'])
def test_plain_mujoco_takes_no_hours_and_writes_no_log(tmp_path, monkeypatch, capfd, option):
    monkeypatch.chdir(tmp_path)
    robot = tmp_path / "odd.xml"
    ball = '<worldbody><body><freejoint/><geom size="0.1"/></body></worldbody>'
    robot.write_text(f"<mujoco><option {option}/>{ball}</mujoco>")
    assert plain_fault(robot, "")
    assert [path.name for path in tmp_path.iterdir()] == ["odd.xml"]
    assert "WARNING" not in "".join(capfd.readouterr())


def test_settings_of_the_camera_are_checked_as_they_will_be_used(tmp_path, capsys):
    words = ["robot", "check", "diff_drive", "--out", str(tmp_path / "sheet.png"), "--json"]
    heights_m = []
    for settings in ([], ["--set", "camera.height_m=0.5"]):
        assert main([*words, *settings]) == 0
        heights_m.append(json.loads(capsys.readouterr().out)["T_base_camera"][2][3])
    assert heights_m[1] == pytest.approx(0.5)
    assert heights_m[0] != heights_m[1]
