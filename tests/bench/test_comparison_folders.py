"""What a comparison finds in its folder: damaged runs, links, and what is in the place of files."""

import json
import re
import shutil

import pytest

from anm_mj.bench.comparison import run_bench
from anm_mj.bench.executor import run_jobs
from anm_mj.bench.run_result import read_results
from anm_mj.bench.sweep import BenchError, read_jobs
from anm_mj.errors import RunFolderError
from tests.scene.small import make_small_scene


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text('scenes = ["home"]\npolicies = ["gvg", "random"]\nstarts = 1\nsteps = 300\n')
    return path


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A comparison of one run, to be copied and damaged."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "small.toml").write_text(
        'scenes = ["home"]\npolicies = ["random"]\nstarts = 1\nseeds = [0]\nsteps = 100\n'
    )
    run_bench(folder / "small.toml", folder / "out", function="tests.bench.fake:quick")
    return folder


@pytest.mark.usefixtures("no_pictures")
def test_a_policy_that_is_edited_while_its_runs_are_made(tmp_path, monkeypatch):
    """The run fails; after it, runs of both versions are told apart."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    module, out = tmp_path / "edited_meanwhile.py", tmp_path / "out"
    module.write_text("class Mine:\n    observe = plan = on_collision = None.__init__\n")
    file = tmp_path / "small.toml"
    file.write_text('scenes = ["home"]\npolicies = ["edited_meanwhile:Mine"]\nstarts = 1\nsteps = 100\n')
    (job,) = read_jobs(file)
    made = run_bench(file, out, function="tests.bench.fake:quick")
    assert not made.failures
    with module.open("a") as text:
        text.write("    speed = 2\n")
    runs = run_jobs([job], out / "again", "local", 1, "tests.bench.fake:quick", (str(tmp_path),))
    ((_, error),) = runs
    assert error is not None
    assert "edited since the comparison began" in error
    assert run_bench(file, out, function="tests.bench.fake:quick").skipped == 0
    with pytest.raises(BenchError, match="two versions of edited_meanwhile:Mine"):
        read_results(out)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("result.json", "{}"),
        ("result.json", "[" * 10_000),
        ("metrics.json", '{"steps": "many"}'),
        ("manifest.json", '{"git": {"revision": 7}}'),
        ("steps.jsonl", '{"action": "STOP", "collided": false, "moved_m": 0.0}\n'),
        ("steps.jsonl", '{"x_m": "NaN", "y_m": 0.0}\n'),
        ("curve.csv", "step\n"),
        ("curve.csv", "step\n10,1,x,2,3\n"),
        ("curve.csv", "step,path_m\n10,1\n"),
        ("curve.csv", "step,completion_ratio\n10,1e300\n"),
        ("curve.csv", "step\n10,1,1,1,1\n5,1,1,1,1\n"),
    ],
)
def test_a_damaged_run_is_named(made, tmp_path, name, content):
    file, out = tmp_path / "small.toml", tmp_path / "out"
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    (run,) = (out / "runs").iterdir()
    (run / name).write_text(content)
    with pytest.raises(BenchError, match=f"{run.name} is damaged .*; delete it, and give the command again"):
        run_bench(file, out, function="tests.bench.fake:quick")


@pytest.mark.parametrize(
    ("key", "value"), [("scene_name", "x/../../../evil"), ("scene_name", "\0"), ("policy", "\udcff"), ("seed", 7)]
)
def test_a_run_of_something_else_than_its_folder_says_is_refused(made, tmp_path, key, value):
    file, out = tmp_path / "small.toml", tmp_path / "out"
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    (run,) = (out / "runs").iterdir()
    facts = json.loads((run / "result.json").read_text())
    (run / "result.json").write_text(json.dumps({**facts, key: value}))
    (out / "curves_x").mkdir()
    with pytest.raises(BenchError, match=f"{run.name} is damaged"):
        run_bench(file, out, function="tests.bench.fake:quick")
    assert {path.name for path in tmp_path.iterdir()} == {"small.toml", "out"}


def test_the_name_of_a_scene_leads_into_no_other_folder(tmp_path):
    file, out = tmp_path / "small.toml", tmp_path / "deep/deep/out"
    scene = make_small_scene(tmp_path / "scene")
    toml = scene.folder / "scene.toml"
    toml.write_text(re.sub(r"(?m)^name = .*$", 'name = "../../evil"', toml.read_text()))
    file.write_text('scenes = ["scene"]\npolicies = ["random"]\nstarts = 1\nseeds = [0]\nsteps = 100\n')
    run_bench(file, out, function="tests.bench.fake:quick")
    assert (out / "curves_..-..-evil.png").is_file()
    assert all(path.is_relative_to(out) for path in tmp_path.glob("**/*evil*"))


@pytest.mark.parametrize("name", ["table.md", "curves_home.svg"])
def test_a_folder_in_the_place_of_a_table_is_named(tmp_path, name):
    file = tmp_path / "two.toml"
    file.write_text('scenes = ["home"]\npolicies = ["gvg"]\nsteps = 300\n')
    out = tmp_path / "out"
    run_bench(file, out, num_workers=1, function="tests.bench.fake:quick")
    (out / name).unlink()
    (out / name / "something").mkdir(parents=True)
    with pytest.raises(BenchError, match=rf"{name} cannot be written \(Is a directory\); remove what is in its place"):
        run_bench(file, out, num_workers=1, function="tests.bench.fake:quick")


def test_nothing_is_written_through_a_link(tmp_path):
    file, out = tmp_path / "small.toml", tmp_path / "out"
    file.write_text('scenes = ["home"]\npolicies = ["random"]\nsteps = 100\n')
    out.mkdir()
    (tmp_path / "precious").write_text("kept")
    (out / "table.md").symlink_to(tmp_path / "precious")
    with pytest.raises(RunFolderError, match=r"table.md is a link"):
        run_bench(file, out, function="tests.bench.fake:quick")
    assert (tmp_path / "precious").read_text() == "kept"


@pytest.mark.usefixtures("no_pictures")
def test_only_unfinished_runs_are_removed_from_a_folder(file, tmp_path):
    (tmp_path / "out" / "runs" / ".git").mkdir(parents=True)
    (tmp_path / "out" / "runs" / ".room_gvg_start0_seed0_01234567-89abcdef").mkdir()
    run_bench(file, tmp_path / "out", function="tests.bench.fake:quick")
    assert [path.name for path in (tmp_path / "out" / "runs").glob(".*")] == [".git"]


@pytest.mark.usefixtures("no_pictures")
def test_metrics_of_another_run_and_what_is_no_folder_are_refused(file, tmp_path):
    (job, *_) = run_bench(file, tmp_path / "out", function="tests.bench.fake:quick").jobs
    folder = tmp_path / "out" / "runs" / job.name
    metrics = json.loads((folder / "metrics.json").read_text())
    for key, value, words in (
        ("completion_ratio", 500.0, "goes from 0 to 100"),
        ("completion_ratio", 1.5, "curve.csv"),
    ):
        (folder / "metrics.json").write_text(json.dumps({**metrics, key: value}))
        with pytest.raises(BenchError, match=words):
            run_bench(file, tmp_path / "out", function="tests.bench.fake:quick")
    shutil.rmtree(folder)
    folder.touch()
    with pytest.raises(BenchError, match="is no folder"):
        run_bench(file, tmp_path / "out", function="tests.bench.fake:quick")


def test_a_contact_that_overlaps_a_little_is_no_damage(made, tmp_path):
    file, out = tmp_path / "small.toml", tmp_path / "out"
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    (run,) = (out / "runs").iterdir()
    metrics = json.loads((run / "metrics.json").read_text())
    (run / "metrics.json").write_text(json.dumps({**metrics, "people_nearest_m": -0.003}))
    assert run_bench(file, out, function="tests.bench.fake:quick").failures == []
