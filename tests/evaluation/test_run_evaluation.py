import dataclasses
import json
import math
import shutil
from types import SimpleNamespace

import numpy as np
import pytest

from anm_mj.errors import RunFolderError
from anm_mj.evaluation import run_evaluation
from anm_mj.evaluation.run_evaluation import add_views, completion_with_halved_intrinsics, evaluate_run
from anm_mj.evaluation.view_quality import ViewQuality, ViewsResult
from anm_mj.frames import pose_matrix
from anm_mj.ground_truth.ground_truth import GroundTruth
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.to_json import write_json
from anm_mj.recording.results import write_results
from anm_mj.types import Footprint, Pose2, StopReason, TrueView
from tests.box_room import FakeMap, ended, new_recorder, observe, record_steps, room_plan


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    path = tmp_path_factory.mktemp("runs") / "finished"
    recorder = new_recorder(path)
    record_steps(recorder, 33)
    write_results(recorder, ended(StopReason.COMPLETE, 3.0), FakeMap(), room_plan(), wall_s=9.0)
    return path


@pytest.fixture
def run(finished, tmp_path):
    return shutil.copytree(finished, tmp_path / "run")


@pytest.fixture
def killed(tmp_path):
    recorder = new_recorder(tmp_path / "killed")
    record_steps(recorder, 33)
    recorder.close()
    return tmp_path / "killed"


def test_a_folder_gives_the_metrics_of_the_live_run(run):
    live = {name: (run / name).read_bytes() for name in ("metrics.json", "curve.csv")}
    for name in (*live, "curve.png"):
        (run / name).write_bytes(live["metrics.json"] if name == "metrics.json" else b"")
    evaluate_run(run)
    assert {name: (run / name).read_bytes() for name in live} == live
    assert (run / "curve.png").stat().st_size > 1_000


def test_facts_of_the_live_run_are_kept(run):
    metrics = evaluate_run(run)
    assert (metrics.stop_reason, metrics.wall_s, metrics.hz) == ("COMPLETE", 9.0, 11.0)


def test_a_killed_run_is_evaluated(killed, finished):
    metrics = evaluate_run(killed)
    whole = json.loads((finished / "metrics.json").read_text())
    assert metrics.completion_ratio == whole["completion_ratio"]
    assert metrics.completion_uncapped_cm == whole["completion_uncapped_cm"]
    assert metrics.accuracy_cm is None
    assert metrics.stop_reason is None
    assert (killed / "curve.csv").read_bytes() == (finished / "curve.csv").read_bytes()


def test_what_another_robot_could_see_is_searched_for_with_its_own_size(run, monkeypatch):
    truth = GroundTruth.load(RunFolder(run).ground_truth)
    dataclasses.replace(truth, observable=None).save(RunFolder(run).ground_truth)
    searched: list[Footprint] = []

    def search(scene, footprint, *rest):
        searched.append(footprint)
        return dataclasses.replace(truth, observable=np.ones(len(truth.samples), bool))

    monkeypatch.setattr(run_evaluation, "load_scene", lambda name: SimpleNamespace(hash="abc"))
    monkeypatch.setattr(run_evaluation, "cached_ground_truth", search)
    manifest = {"scene": "room", "scene_hash": "abc", "robot": "rover.xml"}
    write_json(RunFolder(run).manifest, manifest)
    assert evaluate_run(run).observable_ratio is None
    write_json(RunFolder(run).manifest, manifest | {"footprint": {"radius_m": 0.3, "z_min_m": 0.02, "z_max_m": 0.9}})
    metrics = evaluate_run(run)
    assert metrics.observable_ratio == metrics.completion_ratio
    assert searched == [Footprint(0.3, 0.02, 0.9)]


def test_incomplete_lines_are_skipped(killed):
    for name in ("steps.jsonl", "frames.jsonl", "plans.jsonl"):
        path = killed / name
        path.write_text(path.read_text()[:-40])
    metrics = evaluate_run(killed)
    assert metrics.steps == 32
    assert (killed / "curve.csv").read_text().splitlines()[-1].startswith("32,")


def test_a_run_without_frames_is_refused_and_keeps_its_metrics(tmp_path):
    recorder = new_recorder(tmp_path / "run")
    record_steps(recorder, 0)
    recorder.close()
    (tmp_path / "run" / "frames.jsonl").write_text("")
    before = {path: path.read_bytes() for path in (tmp_path / "run").glob("*.json")}
    with pytest.raises(RunFolderError, match="holds no frame yet"):
        evaluate_run(tmp_path / "run")
    assert {path: path.read_bytes() for path in (tmp_path / "run").glob("*.json")} == before


def test_a_folder_that_is_no_run_is_refused(tmp_path):
    with pytest.raises(RunFolderError, match="is not a folder;"):
        evaluate_run(tmp_path / "nowhere")
    (tmp_path / "latest").mkdir()
    with pytest.raises(RunFolderError, match=r"did you mean .*/latest\?"):
        evaluate_run(tmp_path / "lates")
    with pytest.raises(RunFolderError, match=r"is not the folder of a run: it has no steps\.jsonl"):
        evaluate_run(tmp_path)


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("ground_truth.npz", b"PK", "cannot be read as a true surface"),
        ("mesh.ply", b"ply\nnonsense", "cannot be read as a mesh"),
        ("camera.json", b"{", "cannot be read"),
        ("camera.json", b"{}", "another version"),
        ("camera.json", b"[]", "an object should stand"),
        ("metrics.json", b"", "cannot be read"),
        ("depth/000007.png", b"\x89PNG", "cannot be read"),
        ("steps.jsonl", b"{\n{}\n", "line 1, is not JSON"),
        ("steps.jsonl", b"{}\n", "another version"),
    ],
)
def test_a_damaged_file_is_named(run, name, content, complaint):
    (run / name).write_bytes(content)
    with pytest.raises(RunFolderError, match=complaint) as caught:
        evaluate_run(run)
    assert name.rpartition("/")[2] in str(caught.value) or "another version" in complaint
    assert "\n" not in str(caught.value)


def test_a_missing_depth_picture_is_named(run):
    (run / "depth" / "000003.png").unlink()
    with pytest.raises(RunFolderError, match=r"000003\.png"):
        evaluate_run(run)


def test_frames_count_from_the_true_pose(tmp_path, finished):
    believed = Pose2(0.4, -0.2, 0.5)
    true = Pose2(0.0, 0.0, 0.0)
    view = observe(0, true)
    # The pictures are those of the true pose; the robot believes to stand elsewhere.
    T_believed_true = pose_matrix(believed) @ np.linalg.inv(pose_matrix(true))
    told = dataclasses.replace(view, pose=believed, T_world_camera=T_believed_true @ view.T_world_camera)
    rows = []
    for name, seen, options in (
        ("knows", view, {}),
        ("believes", told, {"true_view": lambda: TrueView(true, view.T_world_camera, view.depth_m)}),
        ("lost", told, {}),
    ):
        recorder = new_recorder(tmp_path / name, **options)
        recorder.observation(seen)
        recorder.close()
        metrics = evaluate_run(tmp_path / name)
        rows.append((metrics.completion_ratio, metrics.completion_cm, metrics.completion_uncapped_cm))
        live = recorder.completion
        assert live is not None
        assert live.completion_ratio == metrics.completion_ratio

    assert rows[0] == rows[1]
    assert rows[0] != rows[2]


def test_metrics_of_views_are_kept(run):
    assert evaluate_run(run).novel_views is None
    novel = ViewsResult(3, ViewQuality(20.0, 21.0, 0.7, math.nan, 40.0, 90.0))
    add_views(run, novel, ViewsResult(200, ViewQuality(19.0, 21.0, 0.6, 2.0, 5.0, 97.0)))

    metrics = evaluate_run(run)

    assert (metrics.novel_views, metrics.novel_view_psnr_db, metrics.novel_view_depth_l1_cm) == (3, 20.0, None)
    assert (metrics.fixed_views, metrics.fixed_view_psnr_db, metrics.fixed_view_depth_error_cm) == (200, 19.0, 5.0)
    assert evaluate_run(run, novel_views=ViewsResult(0, None)).novel_view_psnr_db is None


def test_completion_with_halved_intrinsics_is_that_of_the_run_where_nothing_was_halved(run, monkeypatch):
    own = evaluate_run(run)
    monkeypatch.setattr("anm_mj.evaluation.run_evaluation.halved_intrinsics", lambda intrinsics: intrinsics)
    assert completion_with_halved_intrinsics(run).ratio_percent == own.completion_ratio
    monkeypatch.undo()
    shifted = completion_with_halved_intrinsics(run)
    assert shifted.ratio_percent == pytest.approx(own.completion_ratio, abs=5.0)
