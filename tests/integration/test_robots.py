"""The user's own robot, its odometry and its sequences, from the command line or a script to what they leave."""

import json
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from anm_mj.config import make_config
from anm_mj.io.jsonl import read_jsonl
from anm_mj.run import run
from anm_mj.types import MotionResult, StopReason, WheelSpeeds
from tests.scene.small import make_small_scene

ROOT = Path(__file__).resolve().parents[2]
ROVER_XML = ROOT / "tests" / "rover.xml"


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("scenes") / "small"
    make_small_scene(folder)
    return folder


def explore(scene, out, *settings, **options):
    options = {"steps": 45, "seed": 3, "device": "cpu"} | options
    return run(make_config("quick", list(settings), scene=str(scene), **options), out=out)[1]


def script(name: str, *options: str) -> str:
    return python(str(ROOT / "scripts" / name), *options)


def python(*words: str) -> str:
    """What a Python process prints."""
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("drive", ["kinematic", "physics"])
def test_users_robot(scene, tmp_path, drive):
    metrics = explore(scene, tmp_path / "run", "image_px=48", robot=str(ROVER_XML), drive=drive)
    assert metrics.steps == 45
    assert metrics.collisions <= 2
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_text())
    assert manifest["robot"] == str(ROVER_XML)
    assert len(manifest["robot_hash"]) == 64
    # Its camera stands 0.2 m above the floor and 0.15 m before the axle.
    first = read_jsonl(tmp_path / "run" / "frames.jsonl")[0]
    T_world_camera = np.array(first["T_world_camera"])
    assert T_world_camera[2, 3] == pytest.approx(0.20, abs=0.003)
    assert np.hypot(*(T_world_camera[:2, 3] - (first["x_m"], first["y_m"]))) == pytest.approx(0.151, abs=0.003)


@pytest.mark.slow
def test_odometry_noise(scene, tmp_path):
    def trajectory(name, *settings, **options):
        explore(scene, tmp_path / name, "image_px=32", *settings, policy="random", steps=12, **options)
        return np.loadtxt(tmp_path / name / "trajectory.tum")[:, 1:]

    truth = trajectory("true")
    wheels = trajectory("wheels", pose="odometry")
    np.testing.assert_allclose(wheels, truth, atol=1e-6)
    noisy = trajectory("noisy", "model.wheel_noise=0.05", pose="odometry")
    assert 1e-4 < np.abs(noisy - truth)[:, :2].max() < 0.2


@pytest.mark.slow
def test_recorded_sequence(scene, tmp_path):
    said = script("record_sequence.py", str(scene), str(tmp_path / "walk"), "--steps", "40", "--image-px", "48")
    assert "41 frames" in said
    words = ["map", str(tmp_path / "walk"), "--out", str(tmp_path / "map"), "--preset", "quick", "--shadow"]
    program = (
        f"import sys; from anm_mj.cli.main import main; assert main({words}) == 0; "
        "print('simulators:', {'mujoco', 'mink', 'pinocchio'} & set(sys.modules))"
    )
    said = python("-c", program)
    assert "frame 41/41: would go to (" in said
    assert "simulators: set()" in said
    assert (tmp_path / "map" / "mesh.ply").stat().st_size > 10_000
    assert (tmp_path / "map" / "topdown.png").stat().st_size > 10_000


def test_continuous_control_ends_where_the_robot_can_drive_no_more():
    budget_class = runpy.run_path(str(ROOT / "scripts" / "continuous_control.py"))["Budget"]
    budget = budget_class.__new__(budget_class)
    budget.spent, budget.collisions, budget.steps, budget.fault = 0.0, 0, 10, None
    assert budget.left
    budget.pay(MotionResult(False, WheelSpeeds(0.0, 0.0), 0.0, 0.0, 0.1, StopReason.TOPPLED))
    budget.pay(MotionResult(False, WheelSpeeds(0.0, 0.0), 0.0, 0.0, 0.1))
    assert budget.fault is StopReason.TOPPLED
    assert not budget.left


@pytest.mark.slow
def test_continuous_control(scene):
    said = script("continuous_control.py", str(scene), "--steps", "60", "--image-px", "64")
    assert float(said.split("%")[0]) > 45.0
    assert " 0 collisions" in said


@pytest.mark.slow
def test_bench_drive(tmp_path):
    options = ["--actions", "60", "--triangles", "1000", "--pushes", "3", "--out", str(tmp_path / "figures.json")]
    script("bench_drive.py", *options)
    figures = {f["name"]: f for f in json.loads((tmp_path / "figures.json").read_text())}
    exact = [f for name, f in figures.items() if "CPU" not in name and f["unit"] and f["bound"] is not None]
    assert len(exact) >= 8
    for figure in exact:
        assert figure["value"] <= figure["bound"], figure
