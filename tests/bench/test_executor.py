"""Runs whose worker, driver or cluster dies."""

import importlib.util
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from anm_mj.bench.comparison import run_bench
from anm_mj.bench.executor import run_jobs
from anm_mj.bench.job import Job
from tests.bench.fake import table
from tests.scene.small import make_small_scene


@pytest.mark.slow
def test_a_dead_worker_costs_only_its_run(file, tmp_path):
    bench = run_bench(file, tmp_path / "out", num_workers=2, function="tests.bench.fake:deadly")
    assert len(bench.failures) == 4
    assert "killed by signal 9" in bench.failures[0]
    assert len(table(tmp_path / "out")) == 4

    again = run_bench(file, tmp_path / "out", num_workers=2, function="tests.bench.fake:quick")
    assert (again.skipped, again.failures) == (4, [])
    assert len(table(tmp_path / "out")) == 8


def test_runs_take_egl_devices_in_turn(tmp_path):
    jobs = [Job("room", "room", "0" * 64, "gvg", 0, (0.0, 0.0, 0.0), seed, 1) for seed in range(3)]
    made = run_jobs(jobs, tmp_path, "local", 2, "tests.bench.fake:drawing", egl_devices=[2, 5])
    assert [error for _, error in made] == [None] * 3
    drawn = [(tmp_path / job.name / "drawn").read_text() for job in jobs]
    assert drawn == ["egl 2", "egl 5", "egl 2"]


PROGRAM = """
from pathlib import Path
import sys
from anm_mj.bench.comparison import run_bench
from anm_mj.bench.executor import run_jobs
from anm_mj.bench.job import Job
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


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="looks up processes in /proc")
def test_runs_of_a_comparison_that_ends_in_an_error_end_with_it(tmp_path):
    jobs = [Job("room", "room", "0" * 64, "gvg", 0, (0.0, 0.0, 0.0), seed, 1) for seed in range(3)]
    made = run_jobs(jobs, tmp_path, "local", 2, "tests.bench.fake:lasting")
    assert next(made)[0].seed == 0
    until(lambda: len(list(tmp_path.glob(".*/run/*.pid"))) == 2)
    workers = [int(path.stem) for path in tmp_path.glob(".*/run/*.pid")]
    made.close()
    assert not any(alive(pid) for pid in workers)
    assert not list(tmp_path.glob(".*"))


def test_a_run_that_is_about_to_begin_does_not_once_the_comparison_is_over(tmp_path, monkeypatch):
    jobs = [Job("room", "room", "0" * 64, "gvg", 0, (0.0, 0.0, 0.0), seed, 1) for seed in range(2)]
    open_log, is_late, may_go = Path.open, threading.Event(), threading.Event()

    def late(path, *arguments, **options):
        if path.name == "log.txt" and jobs[1].name in str(path):
            is_late.set()
            assert may_go.wait(60.0)
        return open_log(path, *arguments, **options)

    monkeypatch.setattr(Path, "open", late)
    made = run_jobs(jobs, tmp_path, "local", 2, "tests.bench.fake:quick")
    assert next(made)[0] is jobs[0]
    assert is_late.wait(60.0)
    threading.Timer(1.0, may_go.set).start()
    made.close()
    assert [path.name for path in tmp_path.glob("[!.]*")] == [jobs[0].name]


def test_a_folder_that_cannot_be_written_costs_only_its_run(tmp_path):
    jobs = [Job("room", "room", "0" * 64, "gvg", 0, (0.0, 0.0, 0.0), seed, 1) for seed in range(2)]
    (tmp_path / jobs[0].name).write_text("in the way")
    made = dict(run_jobs(jobs, tmp_path, "local", 1, "tests.bench.fake:quick"))
    assert made[jobs[1]] is None
    assert f"{jobs[0].name} could not be written" in str(made[jobs[0]])


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
from anm_mj.bench.executor import run_jobs
from anm_mj.bench.job import Job
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
from anm_mj.bench.executor import run_jobs
from anm_mj.bench.job import Job

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
