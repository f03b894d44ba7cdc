"""A recorded sequence becomes a run folder that replay, film and exports read."""

import json
import math
import shutil
import sys

import numpy as np
import pytest
import trimesh

from anm_mj.api import load_run
from anm_mj.cli.main import main
from anm_mj.config import make_config
from anm_mj.errors import RunFolderError
from anm_mj.events import Ended, On
from anm_mj.io.folder_hold import held
from anm_mj.io.jsonl import read_jsonl
from anm_mj.io.own_sequence import SequenceWriter
from anm_mj.io.run_events import Mapped
from anm_mj.io.sequence_layouts import SequenceOptions, open_sequence
from anm_mj.map_sequence import _Mapping, map_sequence
from anm_mj.planning.policies.random_walk import RandomWalk
from anm_mj.types import Footprint, Intrinsics, Pose2
from anm_mj.viz.live_view import LiveView
from tests.box_room import ROOM_HIGH_M, ROOM_LOW_M, observe
from tests.fake_robot import FakeRobot

pytestmark = pytest.mark.usefixtures("quick_results")

CAMERA = Intrinsics.from_fov(64, 64, math.radians(90.0))


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded") / "walk"
    writer = SequenceWriter(folder)
    for step in range(16):
        writer.write(observe(step, Pose2(-0.5 + 0.05 * step, 0.0, step * math.pi / 8.0), CAMERA))
    return folder


@pytest.fixture(scope="module")
def mapped(sequence, tmp_path_factory):
    out = tmp_path_factory.mktemp("mapped") / "walk"
    assert main(["map", str(sequence), "--out", str(out), "--preset", "quick", "--shadow"]) == 0
    return out


def test_the_mesh_is_the_room(mapped):
    mesh = trimesh.load_mesh(mapped / "mesh.ply")
    vertices = np.asarray(mesh.vertices)
    to_wall = np.abs(np.minimum(vertices - ROOM_LOW_M, ROOM_HIGH_M - vertices)).min(axis=1)
    assert len(mesh.faces) > 2_000
    assert np.mean(to_wall) < 0.03
    assert (vertices.max(axis=0) > ROOM_HIGH_M - 0.1).all()


def test_poses_in_a_national_grid_give_the_same_mesh_near_the_origin(sequence, mapped, tmp_path, capsys):
    folder, out = tmp_path / "walk", tmp_path / "out"
    shutil.copytree(sequence, folder)
    lines = [line.split() for line in (folder / "poses.tum").read_text().splitlines()]
    far = [(t, float(x) + 530_000.0, float(y) + 180_000.0, *rest) for t, x, y, *rest in lines]
    (folder / "poses.tum").write_text("".join(" ".join(map(str, line)) + "\n" for line in far))
    assert main(["map", str(folder), "--out", str(out), "--preset", "quick"]) == 0
    assert "560 km from the origin" in " ".join(capsys.readouterr().err.split())
    assert json.loads((out / "manifest.json").read_text())["origin_m"] == [530_000.0, 180_000.0, 0.0]
    assert json.loads((mapped / "manifest.json").read_text())["origin_m"] == [0.0, 0.0, 0.0]
    vertices = np.asarray(trimesh.load_mesh(out / "mesh.ply").vertices)
    assert np.abs(np.minimum(vertices - ROOM_LOW_M, ROOM_HIGH_M - vertices)).min(axis=1).mean() < 0.03


def test_the_planner_decides_at_every_frame(mapped):
    plans = read_jsonl(mapped / "plans.jsonl")
    assert [plan["step"] for plan in plans] == list(range(16))
    assert all(plan["reason"] for plan in plans)
    assert not any("bootstrap" in plan["reason"] for plan in plans)
    assert any(plan["target_xy_m"] is not None for plan in plans) or plans[-1]["stop"] == "COMPLETE"
    assert json.loads((mapped / "manifest.json").read_text())["robot"] == "recorded"


def test_replay_film_and_exports_read_it(mapped, tmp_path):
    assert main(["view", str(mapped), "--export-html", str(tmp_path / "replay.html")]) == 0
    assert "walk, gvg, seed 0" in (tmp_path / "replay.html").read_text()
    assert main(["export", str(mapped), "--format", "all", "--out", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "map.yaml").is_file()
    assert main(["export", str(mapped), "--video", str(tmp_path / "film.gif"), "--every", "5"]) == 0


class Listener:
    """Hears what a mapping tells, and ends it after some frames."""

    def __init__(self, last_frame):
        self.last_frame, self.heard = last_frame, []

    def on_event(self, event):
        self.heard.append(event)
        return isinstance(event, Mapped) and event.observation.step == self.last_frame


@pytest.mark.parametrize(
    ("last_frame", "said"), [(None, "Done after 16 frames."), (4, "Ended after 5 frames: INTERRUPTED.")]
)
def test_a_mapping_tells_its_end_and_the_page_how_to_replay_it(sequence, tmp_path, last_frame, said):
    listener, page = Listener(last_frame), LiveView(port=0)
    config = make_config("quick", ["mapping.schedule.final_iterations=1"], scene=str(sequence))
    frames, _ = open_sequence(sequence, SequenceOptions())
    folder = map_sequence(frames, config, FakeRobot.footprint, out=tmp_path / "out", observers=[listener, page])
    page.close()
    (ended,) = [event for event in listener.heard if isinstance(event, Ended)]
    assert listener.heard[-1] is ended
    assert ended.observation.step == ended.num_steps - 1
    assert ended.loop_s > 0.0
    ((_, text),) = [entry for entry in page._server._state.items() if entry[0] == ("ended", "text")]
    assert json.loads(text)["ended"] == f"{said} Replay it: anm-mj view {folder.path}"


def test_a_mapping_is_whole_before_it_tells_its_end(sequence, tmp_path):
    def fail(event):
        raise ValueError("my viewer")

    config = make_config("quick", ["mapping.schedule.final_iterations=1"], scene=str(sequence))
    frames, _ = open_sequence(sequence, SequenceOptions())
    with pytest.raises(ValueError, match="my viewer"):
        map_sequence(frames, config, FakeRobot.footprint, out=tmp_path / "out", observers=[On(Ended, fail)])
    assert (tmp_path / "out" / "mesh.ply").is_file()
    assert (tmp_path / "out" / "metrics.json").is_file()
    assert not (tmp_path / "out" / "checkpoint").exists()


def test_a_folder_without_truth_is_not_evaluated(mapped, capsys):
    assert main(["eval", str(mapped)]) == 2
    assert "without the true surface nothing can be evaluated" in " ".join(capsys.readouterr().err.split())


def test_a_run_folder_can_be_mapped_again(mapped, tmp_path):
    words = ["map", str(mapped), "--out", str(tmp_path / "again"), "--preset", "quick", "--every", "2"]
    assert main(words) == 0
    assert len(read_jsonl(tmp_path / "again" / "frames.jsonl")) == 8
    assert read_jsonl(tmp_path / "again" / "plans.jsonl") == []


class Failing(RandomWalk):
    """Ends the program at its third decision."""

    def plan(self, mapper, observation):
        return super().plan(mapper, observation) if observation.step < 2 else sys.exit()


def test_a_shadow_that_fails_does_not_end_the_mapping(sequence, tmp_path, capsys):
    """It goes on without decisions, also after it was interrupted."""
    folder, out = tmp_path / "walk", tmp_path / "out"
    shutil.copytree(sequence, folder)
    words = ["map", str(folder), "--preset", "quick", "--shadow", "--policy", "tests.test_map_sequence:Failing"]
    (folder / "rgb").rename(tmp_path / "rgb")
    (folder / "rgb").mkdir()
    for step in range(5):
        shutil.copy(tmp_path / "rgb" / f"{step:06d}.png", folder / "rgb")
    assert main([*words, "--out", str(out)]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert said.count("The mapping goes on without decisions because policy tests.test_map_sequence:Failing") == 1
    shutil.copytree(tmp_path / "rgb", folder / "rgb", dirs_exist_ok=True)
    assert main([word for word in [*words, "--resume", str(out)] if word != "--shadow"]) == 2
    assert "shadow is False, and" in " ".join(capsys.readouterr().err.split())
    assert main([*words, "--resume", str(out)]) == 0
    assert len(read_jsonl(out / "frames.jsonl")) == 16
    plans = read_jsonl(out / "plans.jsonl")
    assert [(plan["step"], plan["stop"]) for plan in plans] == [(0, None), (1, None), (2, "POLICY_ERROR")]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--camera", "525,525"], "--camera: '525,525' is not FX,FY,CX,CY"),
        (["--radius", "2"], "makes no sense"),
        (["--layout", "kitti"], "There is no layout 'kitti'"),
    ],
)
def test_wrong_options_are_one_sentence(sequence, tmp_path, capsys, options, words):
    assert main(["map", str(sequence), "--out", str(tmp_path / "out"), *options]) == 2
    assert words in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out").exists()


def test_a_run_that_left_an_image_out_is_read_by_all(sequence, tmp_path, capsys):
    folder, out = tmp_path / "walk", tmp_path / "out"
    shutil.copytree(sequence, folder)
    (folder / "depth" / "000005.png").write_bytes(b"")
    assert main(["map", str(folder), "--out", str(out), "--preset", "quick"]) == 0
    assert [line["step"] for line in read_jsonl(out / "frames.jsonl")] == [*range(5), *range(6, 16)]
    assert main(["view", str(out), "--export-html", str(tmp_path / "replay.html")]) == 0
    for name in ("colmap", "rosbag", "tum"):
        assert main(["export", str(out), "--format", name, "--out", str(tmp_path / name)]) == 0
    assert main(["map", str(out), "--out", str(tmp_path / "again"), "--preset", "quick"]) == 0
    assert len(read_jsonl(tmp_path / "again" / "frames.jsonl")) == 15
    run = load_run(out)
    assert np.nanmax(run.depth_m(6)) > 0.5
    with pytest.raises(RunFolderError, match="no observation 5"):
        run.depth_m(5)


def test_what_was_mapped_before_an_error_is_kept(sequence, tmp_path, capsys):
    folder, out = tmp_path / "walk", tmp_path / "out"
    shutil.copytree(sequence, folder)
    for step in range(8, 16):
        (folder / "rgb" / f"{step:06d}.png").write_bytes(b"")
    assert main(["map", str(folder), "--out", str(out), "--preset", "quick"]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "4 of 16 frames" in said
    assert "Mapping ended after 8 frames" in said
    assert (out / "mesh.ply").is_file()
    metrics = json.loads((out / "metrics.json").read_text())
    assert (metrics["frames"], metrics["left_out_frames"]) == (8, 8)


@pytest.mark.parametrize(
    "options",
    [(), *(pytest.param(words, marks=pytest.mark.slow) for words in (("--shadow",), ("--shadow", "--track")))],
)
def test_a_mapping_that_ended_in_an_error_goes_on_as_if_nothing_had_happened(
    sequence, tmp_path, capsys, monkeypatch, options
):
    """Images that were missing come back; the maps are the same, byte for byte."""
    folder, out, whole = tmp_path / "walk", tmp_path / "out", tmp_path / "whole"
    shutil.copytree(sequence, folder)
    words = ["map", str(folder), "--preset", "quick", *options]
    words += ["--set", "mapping.schedule.final_iterations=1"]
    assert main([*words, "--out", str(whole)]) == 0
    for step in range(5, 12):
        (folder / "rgb" / f"{step:06d}.png").rename(tmp_path / f"{step:06d}.png")
    assert main([*words, "--out", str(out)]) == 2
    assert f"with --resume {out} in place of --out" in " ".join(capsys.readouterr().err.split())
    assert len(read_jsonl(out / "frames.jsonl")) == 5
    for option, value in (("seed", 1), ("radius", 0.3), ("height", 1.0)):
        assert main([*words, "--resume", str(out), f"--{option}={value}"]) == 2
        assert f"{option} is {value}, and" in " ".join(capsys.readouterr().err.split())
    for option in ("--every=2", "--colour-offset=0.001"):
        assert main([*words, "--resume", str(out), option]) == 2
        assert "The sequence is not the one that" in " ".join(capsys.readouterr().err.split())
    for path in tmp_path.glob("*.png"):
        path.rename(folder / "rgb" / path.name)
    with held(out):
        assert main([*words, "--resume", str(out)]) == 2
        assert "Another program is writing" in capsys.readouterr().err
    map_frame, had_map = _Mapping.map_frame, []

    def spy(*arguments) -> bool:
        had_map.append((out / "map.safetensors").exists())
        return map_frame(*arguments)

    monkeypatch.setattr(_Mapping, "map_frame", spy)
    assert main([*words, "--resume", str(out)]) == 0
    # If it is killed now, the map of the first five frames does not pass for that of more.
    assert had_map == [False] * 11
    for name in ("frames.jsonl", "trajectory.tum", "map.safetensors", "mesh.ply"):
        assert (out / name).read_bytes() == (whole / name).read_bytes(), name
    assert [plan["reason"] for plan in read_jsonl(out / "plans.jsonl")] == [
        plan["reason"] for plan in read_jsonl(whole / "plans.jsonl")
    ]
    assert not (out / "checkpoint").exists()
    assert main([*words, "--resume", str(out)]) == 2
    assert "has no checkpoint to resume from" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("goal", ["coverage", "reconstruction"])
def test_a_shadow_has_the_goal_of_the_mapping(sequence, monkeypatch, goal):
    asked = []
    monkeypatch.setattr(RandomWalk, "__init__", lambda self, context: asked.append(context.goal))
    config = make_config("quick", [], scene=str(sequence), policy="random", goal=goal)
    frames, _ = open_sequence(sequence, SequenceOptions())
    _Mapping(frames, config, Footprint(0.18, 0.05, 1.35), shadow=True)
    assert asked == [goal]
