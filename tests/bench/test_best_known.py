import numpy as np
import pytest

from anm_mj.bench.best_known import best_known, situation
from anm_mj.bench.report import markdown
from anm_mj.bench.result import Result
from anm_mj.bench.results_table import tidy_rows
from anm_mj.bench.worker import BOUND

BUDGET = 100


def result(policy, ratios, start=0, folder=None, **job):
    """A run whose observable ratio takes these values, evenly over its steps."""
    steps = np.linspace(0.0, 10.0 * (len(ratios) - 1), len(ratios))
    ratio = np.array(ratios, float)
    known = {"steps": BUDGET, "settings": [], "policy": policy, "scene_name": "flat", "scene_hash": "0" * 64}
    curve = np.stack([steps, ratio / 2.0, 100.0 - ratio, ratio, 0.05 * steps], axis=1)
    known |= {"start": start, "seed": 0, **job}
    return Result(known, {}, "x", curve, **({} if folder is None else {"folder": folder}))


RISE = [0.0, 10.0, 30.0, 60.0, 80.0, 91.0, 92.0, 93.0, 94.0, 95.0, 96.0]


def test_no_row_beats_the_best_known():
    runs = [
        result("gvg", [value + 1.0 for value in RISE]),
        result("frontier", RISE[:4]),
        result("oracle", RISE, settings=["policy.measure=auc"]),
        result("gvg", RISE, start=1),
        result("gvg", RISE, pose="odometry"),
    ]
    rows = tidy_rows(runs)
    assert all(row["observable_ratio_auc"] <= row["best_known_auc"] + 1e-9 for row in rows[:3])
    assert rows[1]["share_of_best_auc"] < rows[2]["share_of_best_auc"] < rows[0]["share_of_best_auc"] == 100.0
    assert rows[0]["best_known_auc_by"] == "gvg"
    assert [row["oracle_ratio_90"] for row in rows[:3]] == [1.0, 2.0, 1.0]
    # A scene without an oracle has no line, and no mean of nothing.
    assert "| other |" not in markdown(tidy_rows([*runs, result("gvg", RISE, scene_name="other")]), "x")
    # From another start, or with another robot's poses, no oracle has run.
    assert [row["best_known_auc"] for row in rows[3:]] == [None, None]

    (line,) = [line for line in markdown(rows, "x").splitlines() if line.startswith("| flat |")]
    assert line.split("|")[2:-1][2].strip() == "1/1"


def test_the_upper_bound_is_never_below_a_run(tmp_path):
    (tmp_path / BOUND).write_text("step,observable_ratio\n0,50.0\n50,90.0\n100,94.0\n")
    oracle = result("oracle", RISE, folder=tmp_path)
    best = best_known([oracle])[situation(oracle)]
    assert best["bound_auc"] == pytest.approx(81.0)
    assert best["bound_final"] == best["final"] == 96.0
    assert best["bound_auc"] > best["auc"]
