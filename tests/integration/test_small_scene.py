"""The real thing on a small scene: MuJoCo rendering, a trained map, a graph out of it, wheel commands, a run folder."""

import json
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from anm_mj.config import make_config
from anm_mj.evaluation.run_evaluation import evaluate_run
from anm_mj.io.jsonl import read_jsonl
from anm_mj.run import run
from tests.scene.small import make_small_scene

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"
pytestmark = pytest.mark.usefixtures("quick_results")

STEPS = 90
FILES = (
    "manifest.json", "config.json", "steps.jsonl", "plans.jsonl", "curve.csv", "metrics.json", "trajectory.tum",
    "mesh.ply", "map.safetensors", "topdown.png", "curve.png",
)  # fmt: skip


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("scenes") / "small"
    make_small_scene(folder)
    return folder


def explore(scene, out, **options):
    options = {"steps": STEPS, "seed": 3, "device": "cpu"} | options
    return run(make_config("quick", [], scene=str(scene), **options), out=out)[1]


@pytest.fixture(scope="module")
def finished(scene, tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "gvg"
    return folder, explore(scene, folder)


def without_times(path: Path) -> list[dict]:
    return [{key: value for key, value in line.items() if key != "ms"} for line in read_jsonl(path)]


def test_a_run_explores_both_rooms_without_touching_anything(finished):
    folder, metrics = finished
    assert metrics.completion_ratio > 55.0
    assert metrics.collisions == 0
    assert metrics.stop_reason in ("BUDGET", "COMPLETE")
    assert metrics.accuracy_cm < 3.0
    assert metrics.hz > 0.0
    for name in FILES:
        assert (folder / name).stat().st_size > 0, name


def test_every_file_of_the_run_can_be_read_back(finished):
    folder, metrics = finished
    steps, plans = read_jsonl(folder / "steps.jsonl"), read_jsonl(folder / "plans.jsonl")
    assert [line["step"] for line in steps] == list(range(1, metrics.steps + 1))
    assert set(steps[0]["ms"]) == {"plan", "act", "observe", "map"}
    assert all(line["reason"] for line in plans)
    # Where a plan still stands, the graph is not rebuilt.
    assert all({"topdown", "gain"} <= set(line["ms"]) for line in plans[1:])
    assert any({"topdown", "graph", "paths", "gain", "choice"} <= set(line["ms"]) for line in plans)
    curve = np.genfromtxt(folder / "curve.csv", delimiter=",", names=True)
    assert np.diff(curve["step"]).max() <= 10
    assert (np.diff(curve["completion_ratio"]) >= 0).all()
    assert len(np.loadtxt(folder / "trajectory.tum")) == metrics.steps + 1
    mesh = trimesh.load(folder / "mesh.ply")
    assert len(mesh.faces) > 1000
    assert mesh.visual.kind == "vertex"
    with Image.open(folder / "topdown.png") as picture:
        assert min(picture.size) > 300
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["gl_backend"] in ("egl", "osmesa")
    assert manifest["camera"] == "gl"
    assert manifest["engine"].startswith(("native", "torch"))
    assert manifest["seed"] == 3
    assert json.loads((folder / "config.json").read_text())["planning"]["margin_m"] > 0


def test_the_same_seed_gives_the_same_steps_and_numbers(finished, scene, tmp_path):
    folder, metrics = finished
    again = explore(scene, tmp_path / "again")
    assert without_times(tmp_path / "again" / "steps.jsonl") == without_times(folder / "steps.jsonl")
    assert (tmp_path / "again" / "trajectory.tum").read_bytes() == (folder / "trajectory.tum").read_bytes()
    assert (tmp_path / "again" / "curve.csv").read_bytes() == (folder / "curve.csv").read_bytes()
    assert again.accuracy_cm == metrics.accuracy_cm


def test_the_numbers_come_out_of_the_folder_alone_as_they_came_out_of_the_run(finished):
    folder, metrics = finished
    curve = (folder / "curve.csv").read_bytes()
    (folder / "curve.csv").unlink()
    assert evaluate_run(folder) == metrics
    assert (folder / "curve.csv").read_bytes() == curve


@pytest.mark.parametrize("options", [{"policy": "random"}, {"policy": "anm-s"}, {"drive": "physics"}])
def test_every_policy_and_drive_completes_a_run(scene, tmp_path, finished, options):
    metrics = explore(scene, tmp_path / "run", **options, steps=50)
    assert metrics.steps == 50
    if options == {"policy": "random"}:
        assert metrics.completion_ratio < finished[1].completion_ratio - 10.0
    else:
        assert metrics.completion_ratio > 30.0


def started(scene, out):
    words = ["explore", scene, "--preset", "quick", "--steps", "5000", "--out", out]
    # A shell's background job ignores SIGINT, and so would what these tests start there.
    heard = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    command = [sys.executable, "-m", "anm_mj.cli", *map(str, words)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, preexec_fn=heard)
    waited = time.monotonic() + 120
    while not (out / "steps.jsonl").exists() or (out / "steps.jsonl").read_text().count("\n") < 12:
        assert process.poll() is None, process.stdout.read()
        assert time.monotonic() < waited
        time.sleep(0.2)
    return process


def test_a_killed_run_leaves_everything_up_to_its_last_step(scene, tmp_path):
    process = started(scene, tmp_path / "run")
    process.kill()
    process.communicate()
    metrics = evaluate_run(tmp_path / "run")
    assert metrics.steps >= 12
    assert metrics.completion_ratio > 5.0
    assert metrics.stop_reason is None


def test_one_interrupt_ends_a_run_well(scene, tmp_path):
    process = started(scene, tmp_path / "run")
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=120)
    assert process.returncode == 0
    assert "INTERRUPTED" in said
    assert f"Resume: anm-mj explore --resume {tmp_path / 'run'}\n" in said
    assert json.loads((tmp_path / "run" / "metrics.json").read_text())["stop_reason"] == "INTERRUPTED"
    for name in FILES:
        assert (tmp_path / "run" / name).exists(), name


def measure(script: str, *options: str) -> str:
    """What a script prints."""
    command = [sys.executable, str(SCRIPTS / script), *options]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def test_the_map_renders_views_from_where_the_robot_never_was(finished):
    folder, _ = finished
    assert "psnr" in measure("novel_views.py", str(folder), "--views", "8")
    views = json.loads((folder / "novel_views.json").read_text())
    assert views["num_views"] == len(views["views"]) == 8
    assert views["mean"]["psnr_known_db"] > 15.0
    # What the run did not see, no map can render.
    seen = [view["quality"] for view in views["views"] if view["observed_percent"] > 95.0]
    assert len(seen) >= 2
    assert np.mean([quality["depth_l1_cm"] for quality in seen]) < 4.0
    trajectory = np.loadtxt(folder / "trajectory.tum")[:, 1:3]
    for view in views["views"]:
        assert np.hypot(*(trajectory - (view["pose"]["x_m"], view["pose"]["y_m"])).T).min() > 0.5
        assert view["observed_percent"] >= 50.0


def test_last_layer_variance_predicts_the_error_best(finished, tmp_path):
    folder, _ = finished
    assert "last_layer_variance" in measure(
        "bench_uncertainty.py", str(folder), "--json-file", str(tmp_path / "areas.json")
    )
    rows = json.loads((tmp_path / "areas.json").read_text())
    areas = {(row["points"], row["method"]): row["area"] for row in rows}
    for points in ("surface", "everywhere"):
        assert areas[points, "last_layer_variance"] < areas[points, "closed form"]


@pytest.mark.slow
def test_presets_are_compared_on_the_pictures_of_a_run(finished, tmp_path):
    folder, _ = finished
    options = ("--presets", "quick", "--seeds", "1", "--json-file", str(tmp_path / "quality.json"))
    assert "accuracy cm" in measure("map_quality.py", str(folder), *options)
    (row,) = json.loads((tmp_path / "quality.json").read_text())
    assert row["accuracy_cm"] < 3.0
    assert row["seen_within_percent"] > 70.0
    assert 0.0 < row["training_s"] < row["mapping_s"]
