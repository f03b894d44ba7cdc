import csv
import importlib.util
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from anm_mj.bench.comparison import run_bench
from anm_mj.bench.sweep import BenchError
from tests.scene.small import make_small_scene

TIMINGS = ("wall_s", "hz", "evaluation_s", "peak_rss_mib")
"""Columns that differ between machines and times, besides those that begin with ``hz_``."""
POLICIES = ["random", "gvg", "frontier", "anm-s"]


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(f'scenes = ["home"]\npolicies = {POLICIES}\nstarts = 1\nseeds = [0, 1]\nsteps = 300\n')
    return path


def table(out):
    """The tidy table without the columns that tell the time."""
    with (out / "results.csv").open() as rows:
        return [
            {k: v for k, v in row.items() if k not in TIMINGS and not k.startswith("hz_")}
            for row in csv.DictReader(rows)
        ]


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
    file = tmp_path / "beside" / "own.toml"
    file.write_text('scenes = ["home"]\npolicies = ["bench_own:MyPolicy"]\nsteps = 300\n')

    bench = run_bench(file, tmp_path / "out", function="bench_own:make")

    assert bench.failures == []
    assert "bench_own:MyPolicy" in (tmp_path / "out" / "table.md").read_text()


def test_existing_runs_are_skipped(file, tmp_path):
    run_bench(file, tmp_path / "out", num_workers=2, function="tests.bench.fake:quick")
    again = run_bench(file, tmp_path / "out", num_workers=2, function="tests.bench.fake:refusing")

    assert (again.skipped, again.failures) == (8, [])


@pytest.mark.slow
def test_a_dead_worker_costs_only_its_run(file, tmp_path):
    bench = run_bench(file, tmp_path / "out", num_workers=2, function="tests.bench.fake:deadly")
    assert len(bench.failures) == 4
    assert "killed by signal 9" in bench.failures[0]
    assert len(table(tmp_path / "out")) == 4

    again = run_bench(file, tmp_path / "out", num_workers=2, function="tests.bench.fake:quick")
    assert (again.skipped, again.failures) == (4, [])
    assert len(table(tmp_path / "out")) == 8


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


def test_a_folder_of_another_revision_is_refused_where_rows_must_compare(file, tmp_path):
    file.write_text('scenes = ["home"]\npolicies = ["gvg", "random"]\nsteps = 30\n')
    run_bench(file, tmp_path / "out", num_workers=2, function="tests.bench.fake:quick")

    with pytest.raises(BenchError, match="0123456789ab, and this program is"):
        run_bench(file, tmp_path / "out", function="tests.bench.fake:quick", one_revision=True)

    (changed,) = (tmp_path / "out" / "runs").glob("*_gvg_*/manifest.json")
    changed.write_text(changed.read_text().replace("0123", "4567"))
    run_bench(file, tmp_path / "out", function="tests.bench.fake:quick")
    assert "rows of several revisions do not compare" in (tmp_path / "out" / "table.md").read_text()


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


def test_another_policy_joins_all_sweeps_without_settings(file, tmp_path):
    text = '[[sweep]]\nscenes = ["home"]\npolicies = ["gvg"]\nsteps = 30\n'
    file.write_text(f'{text}{text}settings = ["planning.margin_m=0.06"]\n')
    bench = run_bench(file, tmp_path / "out", function="tests.bench.fake:quick", policies=["gvg", "random"])
    assert [(job.policy, job.settings) for job in bench.jobs] == [
        ("gvg", ()),
        ("random", ()),
        ("gvg", ("planning.margin_m=0.06",)),
    ]


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


PROGRAM = """
from pathlib import Path
import sys
from anm_mj.bench.comparison import run_bench
run_bench(Path(sys.argv[1]), Path(sys.argv[2]), num_workers=2, function="tests.bench.fake:slow")
"""


def until(condition, timeout_s=60.0):
    end = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    with open(f"/proc/{pid}/stat") as stat:
        return stat.read().rpartition(")")[2].split()[0] != "Z"


@pytest.mark.slow
@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="looks up processes in /proc")
def test_a_killed_comparison_resumes(file, tmp_path):
    run_bench(file, tmp_path / "undisturbed", num_workers=2, function="tests.bench.fake:quick")

    out = tmp_path / "out"
    driver = subprocess.Popen([sys.executable, "-c", PROGRAM, str(file), str(out)])

    def at_work():
        return [int(path.stem) for path in out.glob("runs/.*/run/*.pid")]

    until(lambda: len(list(out.glob("runs/*/result.json"))) >= 2 and len(at_work()) >= 1)
    os.kill(at_work()[0], signal.SIGKILL)
    until(lambda: len(at_work()) >= 1)
    workers = at_work()
    driver.kill()
    driver.wait()
    until(lambda: not any(alive(pid) for pid in workers))
    assert len(list(out.glob("runs/*/result.json"))) < 8

    again = run_bench(file, out, num_workers=2, function="tests.bench.fake:quick")

    assert 2 <= again.skipped < 8
    assert table(out) == table(tmp_path / "undisturbed")
    assert not list(out.glob("runs/.*"))


RAY_PROGRAM = """
import sys
from pathlib import Path
from anm_mj.bench.comparison import run_bench
for function in ("deadly", "quick"):
    bench = run_bench(
        Path(sys.argv[1]), Path(sys.argv[2]), num_workers=2, executor="ray", function=f"tests.bench.fake:{function}"
    )
    print(function, bench.skipped, len(bench.failures), flush=True)
"""


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="Ray is not installed")
def test_ray_makes_the_same_table(file, tmp_path):
    run_bench(file, tmp_path / "here", num_workers=2, function="tests.bench.fake:quick")
    # Ray warns and leaves sockets in ways of its own, so it gets a process of its own.
    arguments = [str(file), str(tmp_path / "ray")]
    done = subprocess.run(
        [sys.executable, "-c", RAY_PROGRAM, *arguments], check=True, stdout=subprocess.PIPE, text=True
    )

    # Half of the runs kill their worker and are made the second time.
    assert done.stdout.split() == ["deadly", "0", "4", "quick", "4", "0"]
    assert table(tmp_path / "ray") == table(tmp_path / "here")


CLUSTER_PROGRAM = """
import os
import sys
from pathlib import Path
from ray.cluster_utils import Cluster
from anm_mj.bench.comparison import run_bench

# Workers look up modules by the folder that they start in.
cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
cluster.add_node(num_cpus=1)
os.environ["RAY_ADDRESS"] = cluster.address
nodes = Path(os.environ["NODES"])
for deadly in (True, False):
    (nodes / "deadly").touch() if deadly else (nodes / "deadly").unlink()
    bench = run_bench(
        Path(sys.argv[1]), Path(sys.argv[2]), num_workers=2, executor="ray", function="tests.bench.fake:on_a_node"
    )
    why = [failure.split()[1:5] for failure in bench.failures[:1]]
    print("table:", bench.skipped, len(bench.failures), *why, flush=True)
cluster.shutdown()
"""


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="Ray is not installed")
@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="looks up processes in /proc")
def test_a_cluster_of_two_nodes_survives_the_death_of_its_workers(file, tmp_path):
    run_bench(file, tmp_path / "here", num_workers=2, function="tests.bench.fake:quick")
    (tmp_path / "nodes").mkdir()
    arguments = [str(file), str(tmp_path / "ray")]
    environment = {**os.environ, "NODES": str(tmp_path / "nodes")}
    done = subprocess.run(
        [sys.executable, "-c", CLUSTER_PROGRAM, *arguments],
        check=True,
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    )

    # Ray prints lines of its own between ours.
    first, second = [line for line in done.stdout.splitlines() if line.startswith("table:")]
    assert first.startswith("table: 0 4 ['was', 'lost', 'with', 'its']")
    assert second == "table: 4 0"
    # One processor on each node: two runs at a time need both.
    assert len([path for path in (tmp_path / "nodes").iterdir() if path.name.isdigit()]) == 2
    assert table(tmp_path / "ray") == table(tmp_path / "here")


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="looks up processes in /proc")
def test_real_runs_resume(tmp_path):
    make_small_scene(tmp_path / "small")
    file = tmp_path / "real.toml"
    file.write_text(
        f'scenes = ["{tmp_path / "small"}"]\npolicies = ["gvg", "frontier", "random"]\nstarts = 2\n'
        'seeds = [0, 1, 2, 3]\nsteps = 12\npreset = "quick"\nviews = false\n'
    )
    command = [sys.executable, "-m", "anm_mj.cli", "bench", str(file), "--workers", "2", "--out"]
    undisturbed, out = tmp_path / "undisturbed", tmp_path / "out"
    subprocess.run([*command, str(undisturbed)], check=True)
    driver = subprocess.Popen([*command, str(out)])

    def workers():
        """Processes of runs that the driver has started."""
        found = []
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                parent = int(stat.read_text().rpartition(")")[2].split()[1])
            except (OSError, ValueError):
                continue
            if parent == driver.pid:
                found.append(int(stat.parent.name))
        return found

    def done():
        return len(list(out.glob("runs/*/result.json")))

    until(lambda: done() >= 6 and len(workers()) == 2, timeout_s=1200.0)
    os.kill(workers()[0], signal.SIGKILL)
    until(lambda: done() >= 10 and len(workers()) == 2, timeout_s=1200.0)
    left = workers()
    driver.kill()
    driver.wait()
    until(lambda: not any(alive(pid) for pid in left))
    assert done() < 24
    again = subprocess.run([*command, str(out)], check=True, stdout=subprocess.PIPE, text=True)

    assert "24 runs" in again.stdout
    assert len(table(out)) == 24
    assert table(out) == table(undisturbed)
