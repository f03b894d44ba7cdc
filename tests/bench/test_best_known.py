import numpy as np
import pytest

from anm_mj.bench.job import Job
from anm_mj.bench.results_table import best_known, situation, tidy_rows
from anm_mj.bench.run_result import Result, split_settings
from anm_mj.bench.tables import markdown
from anm_mj.bench.worker import BOUND
from anm_mj.sim.simulation_config import REALITIES
from anm_mj.utils.read_file import convert

BUDGET = 100


def result(policy, ratios, start=0, folder=None, **job):
    """A run whose observable ratio takes these values, evenly over its steps."""
    steps = np.linspace(0.0, 10.0 * (len(ratios) - 1), len(ratios))
    ratio = np.array(ratios, float)
    known = {"steps": BUDGET, "policy": policy, "scene": "", "scene_name": "flat", "scene_hash": "0" * 64}
    curve = np.stack([steps, ratio / 2.0, 100.0 - ratio, ratio, 0.05 * steps], axis=1)
    known |= {"start": start, "start_pose": [0.0, 0.0, 0.0], "seed": 0, **job}
    return Result(convert(known, Job), {}, "x", curve, **({} if folder is None else {"folder": folder}))


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
    assert [row["times_fewest_90"] for row in rows[:3]] == [1.0, 2.0, 1.0]
    # A scene without an oracle has no line, and no mean of nothing.
    assert "| other |" not in markdown(tidy_rows([*runs, result("gvg", RISE, scene_name="other")]), "x")
    # From another start, or with another robot's poses, no oracle has run.
    assert [row["best_known_auc"] for row in rows[3:]] == [None, None]

    (line,) = [line for line in markdown(rows, "x").splitlines() if line.startswith("| flat |")]
    assert line.split("|")[2:-1][2].strip() == "1/1"


def test_the_fewest_steps_want_an_oracle_from_every_start():
    scenes = ("a", "b")
    runs = [result(policy, RISE, k, scene_name=here) for policy in ("gvg", "anm-s") for k in (0, 1) for here in scenes]
    oracles = [result("oracle", RISE, k, scene_name=here) for here in scenes for k in (0, 1)]
    (own,) = _mean_tables([*runs, *oracles])
    assert "times the fewest steps" in own
    own, with_oracle = _mean_tables([*runs, *oracles[::2]])
    assert "times the fewest steps" not in own
    assert "times the fewest steps" in with_oracle


def test_variants_that_each_lack_another_run_have_means_all_the_same():
    tasks = [(scene, start) for scene in ("a", "b") for start in (0, 1)]
    lacking = dict(zip(("anm-s", "frontier", "upen", "random"), tasks, strict=True))
    runs = [
        result(policy, RISE, start, scene_name=scene)
        for policy in ("gvg", *lacking)
        for scene, start in tasks
        if lacking.get(policy) != (scene, start)
    ]
    tables = _mean_tables(runs)
    assert [sum(f"\n| {name} |" in part for part in tables) for name in ("gvg", *lacking)] == [4, 1, 1, 1, 1]


def _mean_tables(runs):
    return [part for part in markdown(tidy_rows(runs), "x").split("\n## ") if part.startswith("Mean over")]


def test_where_no_run_arrives_there_is_no_fewest():
    rows = tidy_rows([result("gvg", RISE[:4]), result("oracle", RISE[:5])])
    assert all(np.isnan(row["times_fewest_90"]) for row in rows)
    assert "times the fewest steps" not in markdown(rows, "x")


def test_who_stands_still_is_not_ahead_by_its_path():
    moving, still = tidy_rows([result("gvg", RISE), result("random", RISE[:4])])
    assert moving["path_m_to_90"] == pytest.approx(0.05 * 50)
    assert still["path_m_to_90"] == pytest.approx(0.065 * BUDGET)
    assert (moving["restricted_share_to_90"], still["restricted_share_to_90"]) == (50.0, 100.0)


def test_variants_are_compared_with_their_own_policy_and_sensor():
    runs = [
        result("gvg", RISE),
        result("gvg", RISE[:5], sensor="d435i"),
        result("anm-s", RISE[:5], settings=["policy.target=random"]),
        result("anm-s", RISE[:6]),
        result("anm-s", RISE[:4], sensor="d435i"),
        result("gvg", RISE[:7], pose="odometry", settings=["model.wheel_noise=0.02", "sensor.odometry_alpha=(0, 0)"]),
        result("anm-s", RISE[:3], pose="odometry", settings=["model.wheel_noise=0.02", "sensor.odometry_alpha=(0, 0)"]),
    ]
    rows = tidy_rows(runs)
    _, against, own, ours = markdown(rows, "x").split("\n## ")[:4]
    assert against.startswith("gvg against the others")
    assert [line.split(" | ")[0] for line in against.splitlines()[6:]] == [
        "| anm-s (policy.target=random)",
        "| anm-s",
        "| anm-s (d435i)",
        "| anm-s (odometry model.wheel_noise=0.02 sensor.odometry_alpha=(0, 0))",
    ]
    auc = [row["observable_ratio_auc"] for row in rows]
    found = [float(line.split(" | ")[6]) for line in against.splitlines()[6:]]
    pairs = [(0, 2), (0, 3), (1, 4), (5, 6)]
    assert found == pytest.approx([auc[k] - auc[other] for k, other in pairs], abs=0.06)
    assert own.startswith("gvg against its variants")
    assert "| gvg (d435i) | 1 | 1 | 1/1 |" in own
    assert ours.startswith("anm-s against its variants")


def test_means_are_over_the_runs_that_all_rows_have():
    starts = [(scene, start) for scene in ("a", "b") for start in (0, 1)]
    runs = [result("gvg", RISE[: 6 + 4 * start], scene_name=scene, start=start) for scene, start in starts]
    runs += [result("gvg", RISE[:3], scene_name=scene, settings=["a=1"]) for scene in ("a", "b")]
    runs += [result("anm-s", RISE[:7], scene_name=scene, start=start) for scene, start in starts]
    runs[0].metrics["stop_reason"], runs[1].metrics["stop_reason"] = "COMPLETE", "STUCK"
    rows = tidy_rows(runs)
    _, whole, first = markdown(rows, "x").split("\n## ")[:3]
    assert whole.startswith("Mean over 2 scenes, 4 runs of each policy\n")
    assert first.startswith("Mean over 2 scenes, 2 runs of each policy\n")
    auc = [row["observable_ratio_auc"] for row in rows]
    assert f"| gvg | {np.mean(auc[:4]):.1f} |" in whole
    assert "a=1" not in whole
    assert f"| gvg | {auc[0]:.1f} |" in first
    assert f"| gvg (a=1) | {auc[4]:.1f} |" in first
    assert "| COMPLETE 1, STUCK 1 |" in whole
    # RISE reaches 90 % at its sixth row; with the first three it does not.
    reached = whole.splitlines()[4].split("|").index(" runs that reach 90 % [%] ")
    assert [line.split("|")[reached].strip() for line in first.splitlines()[6:9]] == ["100", "0", "100"]


def test_a_failed_run_takes_no_policy_out_of_the_means():
    starts = [(scene, start) for scene in ("a", "b", "c", "d") for start in range(3)]
    failed = {"gvg": ("a", 0), "anm-s": ("b", 1)}
    policies = ("gvg", "anm-s", "frontier")
    runs = [
        result(name, RISE, scene_name=scene, start=start)
        for name in policies
        for scene, start in starts
        if failed.get(name) != (scene, start)
    ]
    runs += [result("upen", RISE, scene_name=scene, start=2) for scene in ("c", "d")]
    _, first, second = markdown(tidy_rows(runs), "x").split("\n## ")[:3]
    assert first.startswith("Mean over 4 scenes, 10 runs of each policy")
    assert second.startswith("Mean over 2 scenes, 2 runs of each policy")
    for text, names in ((first, policies), (second, (*policies, "upen"))):
        rows = [line.split("|")[1].strip() for line in text.splitlines() if line.startswith("| ")]
        assert rows == ["policy", *names]


def test_runs_of_several_budgets_have_no_common_mean():
    runs = [result("gvg", RISE[:k], scene_name=scene, steps=10 * k) for scene in ("a", "b") for k in (5, 10)]
    runs += [result("anm-s", RISE, scene_name=scene) for scene in ("a", "b")]
    text = markdown(tidy_rows(runs), "x").split("\n## ")[1]
    assert "| gvg | 76" not in text.replace(f"{tidy_rows(runs)[1]['observable_ratio_auc']:.1f}", "own")


def test_policies_are_compared_in_the_ideal_and_in_the_real_world():
    real = dict(REALITIES["real"].options, settings=list(REALITIES["real"].texts), reality="real")
    runs = [result(name, RISE[:k], **world) for name, k in (("gvg", 9), ("random", 5)) for world in ({}, real)]
    against = markdown(tidy_rows(runs), "x").split("\n## ")[1]
    assert against.startswith("gvg against the others")
    ideal, other = [line.split(" | ") for line in against.splitlines() if line.startswith("| random")]
    assert ideal[0] == "| random"
    assert "real" in other[0]
    assert ideal[1:] == other[1:]


def test_what_is_unknown_is_not_a_failure():
    runs = [result(name, [np.nan] * 3, scene_name=scene) for name in ("gvg", "anm-s") for scene in ("a", "b")]
    text = markdown(tidy_rows(runs), "x")
    assert "90 %" not in text.partition("\n## ")[2]


def test_settings_of_the_body_are_a_situation_of_their_own():
    blind = result("gvg", RISE, settings=["sensor.max_range_m=3.0"])
    other = result("gvg", RISE, settings=["policy.tour_depth=6"])
    assert situation(blind) != situation(result("gvg", RISE)) == situation(other)
    assert split_settings("model.track_scale=1.1 sensor.odometry_alpha=(0.1, 0.2) policy.a=1") == (
        ["model.track_scale=1.1", "sensor.odometry_alpha=(0.1, 0.2)"],
        ["policy.a=1"],
    )


def test_only_policies_as_they_come_are_tested():
    runs = [result("gvg", RISE[: 4 + k], scene_name=str(k)) for k in range(7)]
    runs += [result("anm-s", RISE[: 3 + k], scene_name=str(k)) for k in range(7)]
    runs += [result("anm-s", RISE[: 3 + k], scene_name=str(k), sensor="d435i") for k in range(7)]
    runs += [result("gvg", RISE[: 4 + k], scene_name=str(k), sensor="d435i") for k in range(7)]
    runs += [result("oracle", RISE, scene_name=str(k)) for k in range(7)]
    sections = {part.splitlines()[0]: part for part in markdown(tidy_rows(runs), "x").split("\n## ")}
    cells = {
        line.split(" | ")[0][2:]: line.split(" | ")
        for line in sections["gvg against the others"].splitlines()
        if line.startswith("| ")
    }
    p = cells["against"].index("p")
    assert (cells["anm-s"][p], cells["anm-s (d435i)"][p], cells["oracle"][p]) == ("0.016", "–", "–")
    # The same runs with another name: level everywhere.
    assert cells["against"][p - 2] == "ahead"
    assert "| gvg (d435i) | 7 | 7 | 0/7, 7 tied |" in sections["gvg against its variants"]
    assert " | p | " not in sections["gvg against its variants"]


def test_where_all_variants_are_unusual_the_plainest_is_the_reference():
    policies = ("gvg", "random")
    runs = [result(name, RISE[: 6 + k], goal="coverage") for k, name in enumerate(policies)]
    runs += [result(name, RISE[:5], goal="coverage", settings=["a=1"]) for name in policies]
    text = markdown(tidy_rows(runs), "x")
    assert "## gvg (coverage) against the others" in text
    assert "| random (coverage a=1) | 1 | 1 |" in text
    assert "## random (coverage) against its variants" in text


def test_where_the_first_view_reaches_a_level_nobody_needs_less_than_once_the_fewest():
    rows = tidy_rows([result("gvg", [95.0, 96.0]), result("oracle", RISE)])
    assert [row["times_fewest_90"] for row in rows] == [1.0, 50.0]


def test_an_unfinished_comparison_says_so():
    rows = tidy_rows([result("gvg", RISE)])
    assert "from 1 run." in markdown(rows, "x", 1)
    assert "from **1 of 3** runs" in markdown(rows, "x", 3)


def test_the_upper_bound_is_never_below_a_run(tmp_path):
    (tmp_path / BOUND).write_text("step,observable_ratio\n0,50.0\n50,90.0\n100,94.0\n")
    oracle = result("oracle", RISE, folder=tmp_path)
    best = best_known([oracle])[situation(oracle)]
    assert best["bound_auc"] == pytest.approx(81.0)
    assert best["bound_final"] == best["final"] == 96.0
    assert best["bound_auc"] > best["auc"]
    # At step 60 the bound has come to 90.8, the run to 92; at the end they are 2 points apart.
    assert best["bound_exceeded"] == pytest.approx(2.0)
