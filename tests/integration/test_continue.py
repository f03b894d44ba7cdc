"""A run goes on from a prior run: real runs in a small scene."""

import json
import shutil

import numpy as np
import pytest

import anm_mj.run
from anm_mj.config import make_config
from anm_mj.errors import MapError, RunFolderError
from anm_mj.evaluation.run_evaluation import evaluate_run
from anm_mj.events import On, Stepped
from anm_mj.resume import resume
from tests.integration.test_kills import OFTEN, TINY, assert_same
from tests.scene.small import make_small_scene

pytestmark = pytest.mark.usefixtures("quick_results")

TIMES = ("wall_s", "hz", "evaluation_s", "peak_rss_mib", "stage_hz")


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenes") / "small"
    make_small_scene(folder)
    return folder


def run(small, out, *, settings=(), steps=6, **options):
    changed = [*TINY, *settings]
    config = make_config("quick", changed, scene=str(small), steps=steps, seed=3, device="cpu", **options)
    return anm_mj.run.run(config, out=out)


@pytest.fixture(scope="module")
def prior(small, tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "prior"
    run(small, out, settings=["record.replay_bytes=200000"])
    return out


def read(folder, name):
    return json.loads((folder / name).read_text())


@pytest.mark.slow
def test_a_continued_run_knows_what_was_covered(small, prior, tmp_path):
    out = tmp_path / "runs" / "next"
    latest = tmp_path / "runs" / "latest"
    latest.parent.mkdir()
    latest.symlink_to(prior)
    _, metrics = run(small, out, continue_from=str(latest))
    latest.unlink()
    before = read(prior, "metrics.json")
    assert metrics.completion_ratio_before == pytest.approx(before["completion_ratio"], abs=1e-3)
    assert metrics.completion_ratio > metrics.completion_ratio_before
    first = (out / "curve.csv").read_text().splitlines()[1].split(",")
    assert float(first[1]) >= metrics.completion_ratio_before
    said = read(out, "manifest.json")["continued_from"]
    assert said == {"run": str(prior), "scene_hash": read(prior, "manifest.json")["scene_hash"], "frames": 7}
    assert read(prior, "manifest.json")["continued_from"] is None
    assert read(out, "changes.json") == {"changes": []}
    # No rotation first: the robot stands where the prior run stood.
    assert "bootstrap" not in (out / "plans.jsonl").read_text().splitlines()[0]
    assert (prior / "explored.safetensors").stat().st_size < 220_000

    known = read(out, "metrics.json")
    evaluate_run(out)
    again = read(out, "metrics.json")
    assert {k: v for k, v in known.items() if k not in TIMES} == {k: v for k, v in again.items() if k not in TIMES}


@pytest.mark.slow
def test_a_continued_run_can_be_continued_by_another_policy(small, prior, tmp_path):
    out = tmp_path / "next"
    _, metrics = run(small, out, continue_from=str(prior))
    _, third = run(small, tmp_path / "third", continue_from=str(out), steps=3, drive="physics", policy="frontier")
    assert third.completion_ratio_before == pytest.approx(metrics.completion_ratio, abs=1e-3)
    assert read(tmp_path / "third", "manifest.json")["continued_from"]["frames"] == 14


@pytest.mark.slow
def test_a_continued_run_can_be_resumed(small, prior, tmp_path):
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    options = {"continue_from": str(prior), "return_to_start": True}
    config = make_config(
        "quick", [*TINY, *OFTEN], scene=str(small), steps=100, seed=3, device="cpu", policy="frontier", **options
    )

    def copy(report):
        if report.step == 36:
            shutil.copytree(whole, cut, ignore=shutil.ignore_patterns(".*"))

    _, metrics = anm_mj.run.run(config, out=whole, observers=(On(Stepped, copy),))
    assert metrics.stop_reason in ("RETURNED", "COMPLETE")
    assert metrics.return_distance_m < 0.1
    assert metrics.return_steps > 0
    # What a run goes on from may be gone by the time that it is resumed.
    kept = prior.rename(prior.with_name("elsewhere"))
    try:
        resume(cut)
    finally:
        kept.rename(prior)
    assert_same(cut, whole)


def test_what_a_folder_lacks_is_said_before_anything_is_written(small, prior, tmp_path):
    copied = tmp_path / "copied"
    shutil.copytree(prior, copied)
    out = tmp_path / "out"
    with pytest.raises(MapError, match="continue with the policy of that run, gvg"):
        anm_mj.run.run(make_config("default", [], scene=str(small), policy="anm", continue_from=str(copied)), out=out)
    arrays = copied / "explored.safetensors"
    arrays.write_bytes(arrays.read_bytes()[:-5])
    with pytest.raises(RunFolderError, match="explore again"):
        run(small, out, continue_from=str(copied))
    arrays.unlink()
    with pytest.raises(RunFolderError, match=r"has no explored.safetensors"):
        run(small, out, continue_from=str(copied))
    (copied / "map.safetensors").unlink()
    with pytest.raises(RunFolderError, match="--resume"):
        run(small, out, continue_from=str(copied))
    with pytest.raises(RunFolderError, match="is not a folder"):
        run(small, out, continue_from=str(tmp_path / "nowhere"))
    assert not out.exists()


def test_no_run_goes_on_from_one_that_keeps_nothing(small, tmp_path):
    _, metrics = run(small, tmp_path / "run", settings=["record.replay_bytes=0"], steps=1)
    assert not (tmp_path / "run" / "explored.safetensors").exists()
    assert metrics.return_steps is None
    assert np.isfinite(metrics.completion_ratio)
