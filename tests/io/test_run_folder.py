import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from anm_mj.errors import RunFolderError
from anm_mj.io.jsonl import LineWriter, read_jsonl
from anm_mj.io.manifest import RunFacts, cpu_model, git_revision, manifest, memory_mib
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.to_json import write_json
from anm_mj.types import StopReason


@dataclass(frozen=True)
class Stage:
    rate: float = 0.1
    shape: tuple[int, ...] = (2, 3)
    where: Path = Path("here")


@dataclass(frozen=True)
class Whole:
    stage: Stage
    reason: StopReason = StopReason.STUCK
    values: object = None


def test_default_name_and_latest(tmp_path):
    first = RunFolder.create(None, "scenes/home.xml", "my.module:Policy", tmp_path / "runs")
    assert first.path.parent == tmp_path / "runs"
    assert first.path.name.startswith("home_my.module-Policy_2")
    assert (tmp_path / "runs" / "latest").resolve() == first.path.resolve()
    second = RunFolder.create(None, "home", "gvg", tmp_path / "runs")
    assert (tmp_path / "runs" / "latest").resolve() == second.path.resolve()
    assert not os.path.isabs(os.readlink(tmp_path / "runs" / "latest"))


def test_a_folder_opened_by_a_link_stays_that_folder(tmp_path, monkeypatch):
    folder = RunFolder.create(None, "home", "gvg", tmp_path / "runs")
    for name in ("steps.jsonl", "frames.jsonl", "camera.json"):
        (folder.path / name).touch()
    monkeypatch.chdir(tmp_path)
    opened = RunFolder.open(Path("runs/latest"))
    RunFolder.create(None, "home", "gvg", tmp_path / "runs")
    assert opened.metrics == Path("runs", folder.path.name, "metrics.json")


def test_two_runs_within_a_second(tmp_path):
    folders = {RunFolder.create(None, "home", "gvg", tmp_path).path for _ in range(3)}
    assert len(folders) == 3


def test_real_folder_named_latest(tmp_path):
    (tmp_path / "latest").mkdir()
    RunFolder.create(None, "home", "gvg", tmp_path)
    assert not (tmp_path / "latest").is_symlink()


def test_given_folder(tmp_path):
    (tmp_path / "a" / "b").mkdir(parents=True)
    for out in (tmp_path / "a" / "b", tmp_path / "c" / "d"):
        assert (RunFolder.create(out, "home", "gvg").path / "depth").is_dir()
    assert not (tmp_path / "a" / "latest").exists()


def test_folder_with_files_is_refused(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(RunFolderError, match="is not empty; choose another"):
        RunFolder.create(tmp_path, "home", "gvg")


def test_file_in_the_way_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    for out in (tmp_path / "file", tmp_path / "file" / "run"):
        with pytest.raises(RunFolderError, match="cannot be made"):
            RunFolder.create(out, "home", "gvg")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_unwritable_folder(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(RunFolderError, match="choose a folder you may write to"):
        RunFolder.create(tmp_path / "run", "home", "gvg")


def test_write_config(tmp_path):
    folder = RunFolder.create(tmp_path / "run", "home", "gvg")
    write_json(folder.config, Whole(Stage(), values={"a": np.float32(0.5), "b": np.arange(2), "c": float("nan")}))
    assert json.loads(folder.config.read_text()) == {
        "stage": {"rate": 0.1, "shape": [2, 3], "where": "here"},
        "reason": "STUCK",
        "values": {"a": 0.5, "b": [0, 1], "c": None},
    }


def test_manifest(tmp_path):
    folder = RunFolder.create(tmp_path / "run", "home", "gvg")
    facts = RunFacts(
        "home", "abc", "diff_drive", "def", "gvg", "both", 3, "cpu", "torch", "egl", "llvmpipe", "gl", "exact"
    )
    write_json(folder.manifest, manifest(facts, ["anm-mj", "explore", "home"]))
    written = json.loads(folder.manifest.read_text())
    assert (written["seed"], written["gl_renderer"], written["scene_hash"]) == (3, "llvmpipe", "abc")
    assert written["packages"]["numpy"] == np.__version__
    assert written["machine"]["cores"] == os.cpu_count()
    assert written["machine"]["cpu"] == cpu_model()
    assert memory_mib() is None or written["machine"]["memory_mib"] > 100


def test_no_revision_outside_a_checkout(tmp_path):
    assert git_revision(tmp_path) is None


def test_a_full_disk_is_told_once_and_the_file_is_closed_all_the_same():
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("there is no /dev/full here")
    log = LineWriter(full)
    with pytest.raises(RunFolderError, match=r"/dev/full cannot be written .*; free some space"):
        log.line("a")
    log.close()
    assert log._file.closed


def test_lines_before_the_last_must_be_whole(tmp_path):
    path = tmp_path / "x.jsonl"
    with LineWriter(path) as file:
        file.json({"a": 1})
        file.json({"a": np.nan})
    assert read_jsonl(path) == [{"a": 1}, {"a": None}]
    path.write_text('{"a": 1}\n{"a":')
    assert read_jsonl(path) == [{"a": 1}]
    path.write_text('{"a": \n{"a": 1}\n')
    with pytest.raises(RunFolderError, match="line 1, is not JSON"):
        read_jsonl(path)
