"""The figure of completion over noise, from made-up runs."""

import json

import pytest

from anm_mj.errors import AnmError
from scripts.noise_figure import main


def write(folder, policy, scale, observable, *, steps=300, collisions=0):
    run = folder / "runs" / f"{policy}_{scale}"
    run.mkdir(parents=True)
    job = {
        "scene": "somewhere",
        "policy": policy,
        "scene_name": "somewhere",
        "scene_hash": "0",
        "start": 0,
        "start_pose": [0.0, 0.0, 0.0],
        "seed": 0,
        "preset": "default",
        "steps": 300,
        "settings": [f"sensor.noise_scale={scale}"] if scale is not None else [],
    }
    (run / "result.json").write_text(json.dumps(job))
    metrics = {"steps": steps, "stop_reason": "COMPLETE" if steps < 300 else "BUDGET", "collisions": collisions}
    (run / "metrics.json").write_text(json.dumps(metrics))
    (run / "curve.csv").write_text(
        f"step,completion_ratio,completion_cm,observable_ratio,path_m\n0,0,9,0,0\n{steps},9,9,{observable},1\n"
    )
    (run / "plans.jsonl").write_text(json.dumps({"ms": {"graph": 2.0, "gain": 3.0}}) + "\n")


def test_completion_contacts_and_early_ends_are_told(tmp_path, capsys):
    write(tmp_path, "gvg", 0, 90.0)
    write(tmp_path, "gvg", 2, 80.0, steps=100, collisions=1)
    write(tmp_path, "anm-s", 0, 97.0, steps=100)
    write(tmp_path, "anm-s", None, 50.0)
    main(tmp_path, tmp_path / "noise.png")
    said = capsys.readouterr().out
    assert "| gvg | somewhere | 90.0 | 80.0 |" in said
    assert "| anm-s | somewhere | 97.0 |  |" in said
    assert "gvg in somewhere at 2: 1 contacts." in said
    assert "gvg in somewhere at 2: COMPLETE with 20.0 % left." in said
    assert "anm-s in somewhere at 0" not in said
    assert "gvg: 2 decisions, median 5.0 ms" in said
    assert (tmp_path / "noise.png").stat().st_size > 1000
    assert (tmp_path / "noise.svg").stat().st_size > 1000


def test_what_has_no_noise_scale_is_refused(tmp_path):
    write(tmp_path, "gvg", None, 90.0)
    with pytest.raises(AnmError, match="holds no run with"):
        main(tmp_path)


def test_two_runs_of_one_kind_are_refused(tmp_path):
    write(tmp_path / "a", "gvg", 1, 90.0)
    write(tmp_path / "b", "gvg", 1, 90.0)
    (tmp_path / "b/runs/gvg_1").rename(tmp_path / "a/runs/gvg_1b")
    with pytest.raises(AnmError, match="two runs"):
        main(tmp_path / "a")
