import json
import math

import numpy as np
import pytest
import trimesh
from PIL import Image

from anm_mj.errors import RunFolderError
from anm_mj.evaluation.completion_curve import CompletionCurve
from anm_mj.io.jsonl import read_jsonl
from anm_mj.io.read_run import read_run
from anm_mj.io.sequence_poses import base_line
from anm_mj.recording.results import peak_rss_mib, write_results
from anm_mj.types import Action, Plan, Pose2, StopReason
from tests.box_room import CAMERA, FakeMap, ended, new_recorder, observe, record_steps, room_depth, room_plan


def test_a_finished_run_leaves_every_file(tmp_path):
    recorder = new_recorder(tmp_path / "run")
    record_steps(recorder, 23)
    finished = FakeMap()
    metrics = write_results(
        recorder, ended(StopReason.BUDGET, 4.6), finished, room_plan(), wall_s=9.0, release=finished.close
    )
    assert finished.closed
    names = {path.name for path in (tmp_path / "run").iterdir()}
    assert names >= {
        "steps.jsonl",
        "plans.jsonl",
        "curve.csv",
        "metrics.json",
        "trajectory.tum",
        "mesh.ply",
        "map.safetensors",
    }
    assert names >= {"topdown.png", "curve.png", "depth", "frames.jsonl", "camera.json", "ground_truth.npz"}
    assert not [name for name in names if name.startswith(".")]
    assert metrics.stop_reason == "BUDGET"
    assert metrics.hz == pytest.approx(5.0)
    assert (metrics.steps, metrics.turns, metrics.collisions) == (23, 16, 1)
    assert metrics.path_m == pytest.approx(7 * 0.065)
    assert metrics.accuracy_cm == pytest.approx(0.0, abs=1e-3)
    assert metrics.mesh_completion_ratio == 100.0
    assert json.loads((tmp_path / "run" / "metrics.json").read_text())["completion_ratio"] == metrics.completion_ratio


def test_logs_are_deterministic_but_for_times(tmp_path):
    for name, time_scale in (("a", 1.0), ("b", 1.37)):
        recorder = new_recorder(tmp_path / name)
        record_steps(recorder, 8, time_scale)
        recorder.close()
    first, second = ((tmp_path / name / "steps.jsonl").read_text().splitlines() for name in "ab")
    assert first != second
    assert [line.partition(', "ms": ')[0] for line in first] == [line.partition(', "ms": ')[0] for line in second]
    assert all(list(json.loads(line))[-1] == "ms" for line in first)
    for name in ("frames.jsonl", "trajectory.tum", "curve.csv", "camera.json", "depth/000008.png"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_every_step_is_on_disk_when_all_is_flushed(tmp_path):
    recorder = new_recorder(tmp_path / "run")
    record_steps(recorder, 11)
    recorder.flush()
    assert [line["step"] for line in read_jsonl(tmp_path / "run" / "steps.jsonl")] == list(range(1, 12))
    assert [line["step"] for line in read_jsonl(tmp_path / "run" / "frames.jsonl")] == list(range(12))
    assert len((tmp_path / "run" / "trajectory.tum").read_text().splitlines()) == 12
    assert [row.partition(",")[0] for row in (tmp_path / "run" / "curve.csv").read_text().splitlines()] == [
        "step",
        "0",
        "10",
    ]
    assert recorder.completion is not None
    assert recorder.completion.step == 10
    recorder.close()


def test_completion_is_unknown_before_the_first_observation(tmp_path):
    with new_recorder(tmp_path / "run") as recorder:
        assert recorder.completion is None


def test_depth_is_reduced_to_millimetres(tmp_path):
    with new_recorder(tmp_path / "run") as recorder:
        recorder.observation(observe(0, Pose2(0.3, 0.2, 0.5)))
    with Image.open(tmp_path / "run" / "depth" / "000000.png") as picture:
        assert picture.mode == "I;16"
        stored = np.asarray(picture).astype(int)
    expected = room_depth(observe(0, Pose2(0.3, 0.2, 0.5)).T_world_camera)[::2, ::2]
    assert stored.shape == (128, 128)
    assert np.abs(stored - 1000.0 * expected).max() <= 0.5001


def test_run_reads_back_as_it_was(tmp_path):
    recorder = new_recorder(tmp_path / "run")
    record_steps(recorder, 6)
    recorder.close()
    run = read_run(tmp_path / "run")
    assert run.intrinsics == CAMERA
    assert [step.action for step in run.steps[:3]] == ["TURN_LEFT", "TURN_LEFT", "MOVE_FORWARD"]
    assert [step.collided for step in run.steps] == [False] * 5 + [True]
    assert run.steps[4].right_radps == 1.5
    pose = Pose2(run.steps[2].x_m, run.steps[2].y_m, run.steps[2].yaw_rad)
    assert run.frames[3].pose == pose
    assert np.array_equal(run.frames[3].T_world_camera, observe(3, pose).T_world_camera)
    assert run.plans[0]["path_length_m"] == pytest.approx(1.0 + math.hypot(0.5, 1.0))
    assert run.plans[0]["candidates"] == [{"xy_m": [1.5, 1.0], "score": 2.0, "gain": 30.0, "cost_steps": 24.0}]


def test_plan_to_stop_or_to_turn_is_logged(tmp_path):
    with new_recorder(tmp_path / "run") as recorder:
        recorder.plan(0, Plan("look around", np.zeros((0, 2)), actions=(Action.TURN_LEFT,) * 2))
        recorder.plan(9, Plan("nothing is left", np.zeros((0, 2)), stop=StopReason.COMPLETE))
    look, stop = read_jsonl(tmp_path / "run" / "plans.jsonl")
    assert (look["target_xy_m"], look["path_length_m"], look["actions"]) == (None, 0.0, ["TURN_LEFT", "TURN_LEFT"])
    assert (stop["stop"], stop["vertices"]) == ("COMPLETE", None)


def test_a_run_without_a_surface_has_metrics(tmp_path, caplog):
    class EmptyMap(FakeMap):
        def mesh(self, resolution_m: float) -> trimesh.Trimesh:
            return trimesh.Trimesh()

    recorder = new_recorder(tmp_path / "run")
    recorder.observation(observe(0, Pose2(0.0, 0.0, 0.0)))
    metrics = write_results(recorder, ended(StopReason.INTERRUPTED, 0.0), EmptyMap(), room_plan(), wall_s=1.0)
    assert metrics.accuracy_cm is None
    assert metrics.hz is None
    assert not (tmp_path / "run" / "mesh.ply").exists()
    assert "holds no surface" in caplog.text


def test_a_map_that_nothing_trained_has_no_mesh(tmp_path, caplog):
    class Untrained(FakeMap):
        is_trained = False

    recorder = new_recorder(tmp_path / "run")
    record_steps(recorder, 1)
    metrics = write_results(recorder, ended(StopReason.BUDGET, 1.0), Untrained(), room_plan(), wall_s=1.0)
    assert metrics.accuracy_cm is None
    assert metrics.completion_ratio > 0.0
    assert not (tmp_path / "run" / "mesh.ply").exists()
    assert not caplog.text


def test_mesh_keeps_its_colours(tmp_path):
    recorder = new_recorder(tmp_path / "run")
    record_steps(recorder, 1)
    write_results(recorder, ended(StopReason.BUDGET, 1.0), FakeMap(), room_plan(), wall_s=1.0)
    mesh = trimesh.load_mesh(tmp_path / "run" / "mesh.ply")
    assert mesh.visual.vertex_colors[0].tolist() == [200, 180, 160, 255]


def test_poses_are_written_in_tum_order():
    assert [float(word) for word in base_line(1.5, Pose2(2.0, 3.0, math.pi / 2)).split()] == pytest.approx(
        [1.5, 2.0, 3.0, 0.0, 0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)]
    )


def test_full_disk_is_one_sentence(tmp_path):
    recorder = new_recorder(tmp_path / "run")
    (tmp_path / "run" / "depth").rmdir()
    (tmp_path / "run" / "depth").write_text("")

    def record():
        # One of them says so, as soon as the thread that writes has failed.
        recorder.observation(observe(0, Pose2(0.0, 0.0, 0.0)))
        recorder.flush()

    with pytest.raises(RunFolderError, match=r"000000\.png cannot be written"):
        record()
    recorder.close()


def test_a_curve_that_cannot_be_computed_ends_the_run(tmp_path, monkeypatch):
    def fail(*_):
        raise MemoryError("no room for the curve")

    recorder = new_recorder(tmp_path / "run")
    monkeypatch.setattr(CompletionCurve, "frame", fail)
    recorder.observation(observe(0, Pose2(0.0, 0.0, 0.0)))
    with pytest.raises(MemoryError, match="no room for the curve"):
        recorder.flush()
    recorder.close()


def test_peak_memory_is_that_of_a_process_with_numpy():
    assert 30.0 < peak_rss_mib() < 100_000.0
