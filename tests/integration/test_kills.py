"""Real runs are killed at random moments and resumed: in the end their folders are those of undisturbed runs."""

import hashlib
import json
import random
import shutil
import signal
import subprocess
import sys
import threading
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import anm_mj.resume as resume_module
import anm_mj.run
from anm_mj.config import make_config
from anm_mj.errors import CheckpointError, RunFolderError
from anm_mj.evaluation.run_evaluation import evaluate_run
from anm_mj.events import On, Stepped
from anm_mj.io.folder_hold import held
from anm_mj.io.run_folder import RunFolder
from anm_mj.mapping.map_file import read_map
from anm_mj.resume import resume
from anm_mj.scene.importing.import_scene import import_scene
from anm_mj.types import FREE, OCCUPIED
from anm_mj.utils.files import beside
from tests.public_scenes import PUBLIC_SCENES
from tests.scene.small import make_small_scene

pytestmark = pytest.mark.usefixtures("quick_results")

HOUSE = PUBLIC_SCENES / "aws_small_house.glb"
"""A scene of others; left out where it is missing."""
TINY = (
    "image_px=64",
    "mapping.schedule.first_iterations=5",
    "mapping.schedule.final_iterations=20",
    "mapping.schedule.replay_bytes=2000000",
)
GROWING = ("mapping.field.log2_table_size=11", "mapping.field.entries_per_m3=2000.0")
"""The table doubles on the way, so that a resumed run begins with another one than it began with."""
OFTEN = ("checkpoint.every_steps=10", "checkpoint.loop_share=1")
TIMES = ("wall_s", "hz", "evaluation_s", "peak_rss_mib", "stage_hz")


def started(*words, cwd=None):
    command = [sys.executable, "-m", "anm_mj.cli", "explore", *map(str, words)]
    # Below nohup, SIGHUP is ignored, and so it would be here.
    heard = partial(signal.signal, signal.SIGHUP, signal.SIG_DFL)
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=cwd, preexec_fn=heard
    )


def finished(*words, cwd=None):
    process = started(*words, cwd=cwd)
    said, _ = process.communicate(timeout=1200)
    assert process.returncode == 0, said
    return said


def words(scene, *, steps, settings=(), **options):
    named = [word for name, value in options.items() for word in (f"--{name}", value)]
    changed = [word for setting in (*settings, *OFTEN) for word in ("--set", setting)]
    return [scene, "--preset", "quick", "--steps", steps, "--seed", 3, "--device", "cpu", *named, *changed]


def content(path):
    """A file without times, and without what follows from times alone."""
    if path.suffix == ".jsonl":
        lines = [json.loads(line) for line in path.read_text().splitlines()]
        return [{key: value for key, value in line.items() if key != "ms"} for line in lines]
    if path.name == "metrics.json":
        return {key: value for key, value in json.loads(path.read_text()).items() if key not in TIMES}
    if path.name == "manifest.json":
        return {key: value for key, value in json.loads(path.read_text()).items() if key not in ("command", "started")}
    return hashlib.sha256(path.read_bytes()).hexdigest()


def contents(folder):
    # Pictures carry the name of their folder as a title.
    left_out = ("resumed.jsonl", "topdown.png", "curve.png")
    files = [path for path in folder.rglob("*") if path.is_file() and path.name not in left_out]
    return {str(path.relative_to(folder)): content(path) for path in files}


def assert_same(folder, undisturbed):
    found, wanted = contents(folder), contents(undisturbed)
    assert set(found) == set(wanted)
    assert [name for name in wanted if found[name] != wanted[name]] == []


def num_steps(folder):
    path = folder / "steps.jsonl"
    return path.read_bytes().count(b"\n") if path.exists() else 0


def kill_at(process, folder, moment):
    """Kill the run when ``moment`` says so; False if it ended before."""
    until = time.monotonic() + 600
    while not moment(folder):
        if process.poll() is not None:
            return False
        assert time.monotonic() < until
        time.sleep(0.002)
    process.kill()
    process.communicate()
    return True


def after(steps, seconds):
    """A moment so many seconds after a step."""
    reached = []

    def moment(folder):
        if not reached and num_steps(folder) >= steps and any(folder.glob("checkpoint/*.checkpoint")):
            reached.append(time.monotonic())
        return bool(reached) and time.monotonic() - reached[0] >= seconds

    return moment


def while_writing(steps):
    """A moment while a checkpoint is being written, from a step on."""

    def moment(folder):
        # Before the first one is whole, there is nothing to resume from.
        whole = any(folder.glob("checkpoint/*.checkpoint"))
        return num_steps(folder) >= steps and whole and any(folder.glob("checkpoint/.*"))

    return moment


def checkpoints_are_written():
    """Wait for it: on a slow disk, the loop would go on without checkpoints while one is being written."""
    for thread in threading.enumerate():
        if thread.name == "checkpoint":
            thread.join()


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenes") / "small"
    make_small_scene(folder)
    return folder


def test_a_run_that_was_cut_off_ends_as_an_undisturbed_one(small, tmp_path):
    """What is in the folder at a moment is what a kill at that moment leaves; the last checkpoint is being written."""
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    refused = []

    def copy(report):
        if report.step == 30:
            for other in (resume, evaluate_run):
                with pytest.raises(RunFolderError, match="Another program is writing"):
                    other(whole)
                refused.append(other)
        checkpoints_are_written()
        if report.step == 21:
            shutil.copytree(whole, killed, ignore=shutil.ignore_patterns(".*"))

    settings = [*TINY, *OFTEN, *GROWING]
    config = make_config("quick", settings, scene=str(small), steps=36, seed=3, device="cpu")
    anm_mj.run.run(config, out=whole, observers=(On(Stepped, copy),))
    assert refused == [resume, evaluate_run]
    assert read_map(whole / "map.safetensors").config.field.log2_table_size > 11
    for half_written in ("mesh.ply", "checkpoint/000030.checkpoint"):
        beside(killed / half_written).touch()
    with (killed / "steps.jsonl").open("a") as file:
        file.write('{"step": 99, "act')
    newest = max(killed.glob("checkpoint/*"))
    newest.write_bytes(newest.read_bytes()[:-1000])
    resume(killed)
    assert_same(killed, whole)
    assert json.loads((killed / "resumed.jsonl").read_text())["step"] < 36
    assert not (killed / "checkpoint").exists()
    assert not list(killed.glob(".*"))
    with pytest.raises(CheckpointError, match="has ended"):
        resume(killed)
    # Nothing is read before the folder is held: another program may be about to end the run.
    with held(killed), pytest.raises(RunFolderError, match="Another program is writing"):
        resume(killed)


def test_an_interrupted_run_leaves_doubted_surface_in_its_map_and_the_doubt_to_who_resumes_it(small, tmp_path):
    folder, solid, doubts = tmp_path / "run", [], []

    def doubt(stepped):
        if stepped.step < 4:
            return False
        by_depth = stepped.mapper.occupancy.by_depth
        solid.append(by_depth.voxels.state == OCCUPIED)
        columns, _ = by_depth.blocks_with_hits()
        by_depth._moved._ever = {(x, y) for x, y, _ in columns.tolist()}
        assert by_depth.doubt_moved()
        doubts.append(np.count_nonzero(solid[0] & (by_depth.voxels.state == FREE)))
        return True

    config = make_config("quick", [*TINY, *OFTEN], scene=str(small), steps=6, seed=3, device="cpu")
    anm_mj.run.run(config, out=folder, observers=(On(Stepped, doubt),))
    assert doubts[0] > 50
    arrays = read_map(folder / "map.safetensors").occupancy
    assert np.array_equal(arrays["state"] == OCCUPIED, solid[0])

    def still(stepped):
        places, _ = stepped.mapper.occupancy.by_depth._moved._doubted
        doubts.append(len(places))
        return True

    resume(folder, observers=(On(Stepped, still),))
    assert doubts[1] > 0


def test_a_checkpoint_that_does_not_fit_leaves_the_run_as_it_was(small, tmp_path, monkeypatch):
    folder = tmp_path / "run"
    settings = [*TINY, "checkpoint.every_steps=4", "checkpoint.loop_share=1"]
    config = make_config("quick", settings, scene=str(small), steps=20, seed=3, device="cpu")
    with pytest.raises(RuntimeError, match="cut off"):
        anm_mj.run.run(config, out=folder, observers=(On(Stepped, lambda stepped: _cut_off(stepped.step == 7)),))
    before = contents(folder)
    assert num_steps(folder) > 4
    with monkeypatch.context() as patch:
        patch.setattr(resume_module, "lay_over", _refuse)
        with pytest.raises(CheckpointError, match="does not fit"):
            resume(folder)
    assert contents(folder) == before
    resume(folder)
    assert num_steps(folder) == 20


def _cut_off(now):
    if now:
        raise RuntimeError("cut off")


def _refuse(*_):
    raise CheckpointError("The checkpoint at step 4 does not fit this run.")


@pytest.mark.slow
def test_a_link_to_the_latest_run_may_move_while_that_is_resumed(small, tmp_path):
    runs = tmp_path / "runs"
    config = make_config("quick", [*TINY, *OFTEN], scene=str(small), steps=6, seed=3, device="cpu")
    folder = RunFolder.create(None, "small", "gvg", runs)
    shutil.rmtree(folder.path)
    anm_mj.run.run(config, out=folder.path, observers=(On(Stepped, lambda stepped: stepped.step == 3),))
    made = []

    def another(stepped):
        made.append(RunFolder.create(None, "other", "gvg", runs).path)

    assert resume(runs / "latest", observers=(On(Stepped, another),))[0].path == folder.path
    assert (folder.path / "mesh.ply").is_file()
    assert all(sorted(path.name for path in other.iterdir()) == ["depth"] for other in made)
    assert not any(list((other / "depth").iterdir()) for other in made)


@pytest.mark.slow
def test_other_software_than_before_is_said_and_noted(small, tmp_path, caplog):
    folder = tmp_path / "run"
    config = make_config("quick", [*TINY, *OFTEN], scene=str(small), steps=4, seed=3, device="cpu")
    anm_mj.run.run(config, out=folder, observers=(On(Stepped, lambda stepped: stepped.step == 2),))
    said = json.loads((folder / "manifest.json").read_text())
    (folder / "manifest.json").write_text(json.dumps(said | {"packages": said["packages"] | {"mujoco": "2.0.0"}}))
    resume(folder)
    assert "goes on with another packages than it began with" in caplog.text
    assert json.loads((folder / "resumed.jsonl").read_text())["packages"] == said["packages"]


def test_an_error_after_a_later_checkpoint_is_none_of_the_one_it_resumed_from(small, tmp_path):
    folder = tmp_path / "run"
    config = make_config("quick", [*TINY, *OFTEN], scene=str(small), steps=30, seed=3, device="cpu")
    anm_mj.run.run(config, out=folder, observers=(On(Stepped, lambda stepped: stepped.step == 2),))

    def fail(stepped):
        checkpoints_are_written()
        later = [path for path in folder.glob("checkpoint/[!.]*") if int(path.stem) > 2]
        if later:
            raise KeyError("unforeseen")

    with pytest.raises(KeyError, match="unforeseen"):
        resume(folder, observers=(On(Stepped, fail),))
    _, metrics = resume(folder)
    assert metrics.steps == 30


def test_code_that_a_folder_names_is_not_run(small, tmp_path):
    folder = tmp_path / "run"
    config = make_config("quick", [*TINY, *OFTEN], scene=str(small), steps=2, seed=3, device="cpu")
    anm_mj.run.run(config, out=folder, observers=(On(object, lambda event: True),))
    said = json.loads((folder / "config.json").read_text())
    (folder / "config.json").write_text(json.dumps(said | {"policy": "antigravity:Policy"}))
    with pytest.raises(CheckpointError, match="add --policy antigravity:Policy"):
        resume(folder)
    assert "antigravity" not in sys.modules
    (folder / "config.json").write_text(json.dumps(said | {"policy": {"__class__": "antigravity"}}))
    with pytest.raises(CheckpointError, match="is no name; copy the run again"):
        resume(folder)
    (folder / "config.json").write_text(json.dumps(said))
    (tmp_path / "elsewhere").write_text("kept")
    (folder / "curve.png").unlink()
    (folder / "curve.png").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(RunFolderError, match=r"curve\.png is a link"):
        resume(folder)
    assert (tmp_path / "elsewhere").read_text() == "kept"


def test_settings_that_were_edited_are_refused_and_a_longer_budget_is_not(small, tmp_path):
    folder = tmp_path / "run"
    config = make_config("quick", [*TINY, *OFTEN], scene=str(small), steps=9, seed=3, device="cpu")
    anm_mj.run.run(config, out=folder, observers=(On(object, lambda event: num_steps(folder) >= 2),))
    said = json.loads((folder / "config.json").read_text())
    edited = {
        "seed = 4, and the run was made with 3": said | {"seed": 4},
        "policy = 'frontier', and the run was made with 'gvg'": said | {"policy": "frontier", "policy_settings": {}},
        r"planning.margin_m = 0.07": said | {"planning": said["planning"] | {"margin_m": 0.07}},
        r"no/scene.*has moved, write its present place there": said | {"scene": "no/scene"},
        r"no/robot.xml.*has moved, write its present place there": said | {"robot": "no/robot.xml"},
    }
    for why, values in edited.items():
        (folder / "config.json").write_text(json.dumps(values))
        with pytest.raises(CheckpointError, match=why):
            resume(folder)
    (folder / "config.json").write_text(json.dumps(said | {"steps": 12}))
    _, metrics = resume(folder)
    assert metrics.steps == 12


CASES = [
    ("home", "gvg", "kinematic"),
    ("home", "anm-s", "physics"),
    (HOUSE, "gvg", "physics"),
    (HOUSE, "anm-s", "kinematic"),
]


@pytest.mark.slow
@pytest.mark.timeout(3000)
@pytest.mark.parametrize(("scene", "policy", "drive"), CASES, ids=lambda value: Path(str(value)).name)
def test_twenty_kills(scene, policy, drive, tmp_path):
    """Five for each case: four at random moments, one of them twice in a row, and one while a checkpoint is written."""
    if scene == HOUSE:
        if not HOUSE.is_file():
            pytest.skip(f"{HOUSE.name} is not here")
        scene = import_scene(HOUSE, tmp_path / "scene").folder
    run = words(scene, steps=100, policy=policy, drive=drive)
    finished(*run, "--out", tmp_path / "whole")
    draw = random.Random(f"{scene}{policy}{drive}")
    for kill in range(5):
        folder = tmp_path / f"killed{kill}"
        step = draw.randrange(1, 95)
        moment = while_writing(step) if kill == 0 else after(step, draw.random())
        if not kill_at(started(*run, "--out", folder), folder, moment):
            assert_same(folder, tmp_path / "whole")
            continue
        if kill == 1:
            kill_at(started("--resume", folder), folder, after(num_steps(folder) + 3, 0.3))
        if (folder / "metrics.json").exists():
            assert_same(folder, tmp_path / "whole")
            continue
        print(kill, step, finished("--resume", folder).splitlines()[0])
        assert_same(folder, tmp_path / "whole")


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_run_well_and_it_can_be_resumed(small, tmp_path, number):
    process = started(*words(small, steps=300, settings=TINY), "--out", tmp_path / "run")
    until = time.monotonic() + 120
    while num_steps(tmp_path / "run") < 5:
        assert process.poll() is None, process.communicate()[0]
        assert time.monotonic() < until
        time.sleep(0.05)
    process.send_signal(number)
    said, _ = process.communicate(timeout=300)
    assert process.returncode == 0, said
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert metrics["stop_reason"] == "INTERRUPTED"
    for name in ("map.safetensors", "mesh.ply", "topdown.png", "curve.csv"):
        assert (tmp_path / "run" / name).stat().st_size > 0
    assert [path.stem for path in (tmp_path / "run" / "checkpoint").glob("*")][-1:] != []
