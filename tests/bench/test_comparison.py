import sys

import pytest

from anm_mj.bench.comparison import run_bench
from anm_mj.bench.sweep import BenchError
from tests.bench.fake import POLICIES, table


def test_every_run_is_a_row(file, tmp_path):
    bench = run_bench(
        file, tmp_path / "out", num_workers=2, command=["anm-mj", "bench"], function="tests.bench.fake:quick"
    )

    rows = table(tmp_path / "out")
    assert (len(bench.jobs), bench.skipped, bench.failures) == (8, 0, [])
    assert len(rows) == 8
    assert len({(row["policy"], row["start"], row["seed"]) for row in rows}) == 8
    assert {row["revision"] for row in rows} == {"0123456789ab"}
    assert all(len(row["scene_hash"]) == 64 for row in rows)
    text = (tmp_path / "out" / "table.md").read_text()
    assert "anm-mj bench" in text
    assert all(f"| {policy} |" in text for policy in POLICIES)
    assert " ± " in text
    assert (tmp_path / "out" / "command.txt").read_text() == "anm-mj bench\n"
    assert (tmp_path / "out" / "curves_home.png").stat().st_size > 5_000
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 3
    assert "http" not in page.replace("http://www.w3.org/2000/svg", "")
    assert "<td>gvg</td>" in page
    card = (tmp_path / "out" / "data_card.md").read_text()
    assert rows[0]["scene_hash"][:12] in card
    assert "`gvg`, `frontier`" in card


@pytest.mark.usefixtures("no_pictures")
def test_a_policy_with_other_settings_is_another_row(tmp_path):
    sweep = '[[sweep]]\nscenes = ["home"]\npolicies = ["anm-s"]\nsteps = 300\n'
    file = tmp_path / "ablation.toml"
    file.write_text(
        f'{sweep}{sweep}settings = ["policy.target=random"]\n{sweep}preset = "paper"\n{sweep}sensor = "d435i"\n'
    )

    run_bench(file, tmp_path / "out", num_workers=2, function="tests.bench.fake:quick")

    text = (tmp_path / "out" / "table.md").read_text().partition("## home")[2]
    names = [line.split("|")[1].strip() for line in text.splitlines() if line.startswith("| anm-s")][:4]
    assert names == ["anm-s", "anm-s (policy.target=random)", "anm-s (paper)", "anm-s (d435i)"]


OWN = """
from anm_mj.planning.policies.random_walk import RandomWalk
from tests.bench.fake import quick


class MyPolicy(RandomWalk):
    pass


def make(job, folder):
    job.config()
    quick(job, folder)
"""


def test_a_policy_beside_the_file_is_found(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path])
    (tmp_path / "beside").mkdir()
    (tmp_path / "beside" / "bench_own.py").write_text(OWN)
    # What is named like a module of Python's is nobody's policy.
    (tmp_path / "beside" / "json.py").write_text("raise RuntimeError")
    file = tmp_path / "beside" / "own.toml"
    file.write_text('scenes = ["home"]\npolicies = ["bench_own:MyPolicy"]\nsteps = 300\n')

    bench = run_bench(file, tmp_path / "out", function="bench_own:make")

    assert bench.failures == []
    assert "bench_own:MyPolicy" in (tmp_path / "out" / "table.md").read_text()


@pytest.mark.usefixtures("no_pictures")
def test_existing_runs_are_skipped(file, tmp_path):
    run_bench(file, tmp_path / "out", num_workers=2, function="tests.bench.fake:quick")
    again = run_bench(file, tmp_path / "out", num_workers=2, function="tests.bench.fake:refusing")

    assert (again.skipped, again.failures) == (8, [])


def test_errors_of_runs_are_reported(file, tmp_path):
    file.write_text(file.read_text().replace("seeds = [0, 1]", "seeds = [7]"))
    bench = run_bench(file, tmp_path / "out", function="tests.bench.fake:refusing")

    assert bench.failures[0].endswith("Seed 7 is not liked; take another.")
    assert not (tmp_path / "out" / "results.csv").exists()


@pytest.mark.parametrize(
    ("options", "match"), [({"executor": "slurm"}, "local, ray"), ({"num_workers": 0}, "at least 1")]
)
def test_bad_options_are_refused(file, tmp_path, options, match):
    with pytest.raises(BenchError, match=match):
        run_bench(file, tmp_path / "out", **options)


@pytest.mark.usefixtures("no_pictures")
def test_a_folder_of_another_revision_is_refused_where_rows_must_compare(file, tmp_path):
    file.write_text('scenes = ["home"]\npolicies = ["gvg", "random"]\nsteps = 30\n')
    run_bench(file, tmp_path / "out", num_workers=2, function="tests.bench.fake:quick")

    with pytest.raises(BenchError, match="0123456789ab, and this program is"):
        run_bench(file, tmp_path / "out", function="tests.bench.fake:quick", one_revision=True)

    (changed,) = (tmp_path / "out" / "runs").glob("*_gvg_*/manifest.json")
    changed.write_text(changed.read_text().replace("0123", "4567"))
    run_bench(file, tmp_path / "out", function="tests.bench.fake:quick")
    assert "rows of several revisions do not compare" in (tmp_path / "out" / "table.md").read_text()


@pytest.mark.usefixtures("no_pictures")
def test_a_run_is_cut_at_both_budgets(file, tmp_path):
    file.write_text('scenes = ["home"]\npolicies = ["gvg", "random"]\nbudget = "both"\n')
    (job, *_) = run_bench(file, tmp_path / "out", num_workers=2, function="tests.bench.fake:quick").jobs

    (_, by_area), (_, by_rooms) = job.cuts
    rows = table(tmp_path / "out")
    assert {(row["budget_by"], row["budget"]) for row in rows} == {("area", str(by_area)), ("rooms", str(by_rooms))}
    assert job.steps == max(by_area, by_rooms) > min(by_area, by_rooms)
    short, long = sorted((row for row in rows if row["policy"] == "gvg"), key=lambda r: int(r["budget"]))
    assert int(short["steps"]) == int(short["turns"]) + int(short["forwards"]) == min(by_area, by_rooms)
    assert float(short["path_m"]) == pytest.approx(0.04 * int(short["budget"]))
    assert float(short["observable_ratio_auc"]) < float(long["observable_ratio_auc"])
    assert short["stop_reason"] == "BUDGET"
    text = (tmp_path / "out" / "table.md").read_text()
    assert text.count("gvg against the others, budget by") == 2


@pytest.mark.usefixtures("no_pictures")
def test_another_policy_joins_all_sweeps_without_settings(file, tmp_path):
    text = '[[sweep]]\nscenes = ["home"]\npolicies = ["gvg"]\nsteps = 30\n'
    file.write_text(f'{text}{text}settings = ["planning.margin_m=0.06"]\n')
    bench = run_bench(file, tmp_path / "out", function="tests.bench.fake:quick", policies=["gvg", "random"])
    assert [(job.policy, job.settings) for job in bench.jobs] == [
        ("gvg", ()),
        ("random", ()),
        ("gvg", ("planning.margin_m=0.06",)),
    ]


@pytest.mark.usefixtures("no_pictures")
def test_start_after_start_is_run_with_its_oracles_last(tmp_path):
    file = tmp_path / "small.toml"
    file.write_text('scenes = ["home"]\npolicies = ["oracle", "gvg", "random"]\nstarts = 2\nsteps = 300\n')
    made = []
    bench = run_bench(
        file, tmp_path / "out", function="tests.bench.fake:quick", on_run=lambda done, total, last: made.append(last)
    )
    policies = ["gvg", "random", "oracle", "oracle"]
    jobs = {job.name: (job.start, job.policy) for job in bench.jobs}
    assert [jobs[name] for name in made if name] == [(start, policy) for start in (0, 1) for policy in policies]


@pytest.mark.slow
def test_a_comparison_locks_its_folder(file, tmp_path):
    run_bench(file, tmp_path / "out", function="tests.bench.fake:quick")
    refused = []

    def begin_another(done, total, last):
        with pytest.raises(BenchError, match="Another comparison") as caught:
            run_bench(file, tmp_path / "out", function="tests.bench.fake:quick")
        refused.append(caught.value)

    run_bench(file, tmp_path / "out", function="tests.bench.fake:quick", on_run=begin_another)

    assert refused
