"""Runs that take a moment and explore nothing; what comes out depends on the job alone."""

import csv
import json
import os
import signal
import time
from pathlib import Path

import numpy as np

from anm_mj.bench.job import Job
from anm_mj.errors import PlanError

TIMINGS = ("wall_s", "hz", "evaluation_s", "peak_rss_mib")
"""Columns that differ between machines and times, besides those that begin with ``hz_``."""
POLICIES = ["random", "gvg", "frontier", "anm-s"]


def table(out):
    """The tidy table without the columns that tell the time."""
    with (out / "results.csv").open() as rows:
        return [
            {k: v for k, v in row.items() if k not in TIMINGS and not k.startswith("hz_")}
            for row in csv.DictReader(rows)
        ]


def quick(job: Job, folder: Path) -> None:
    write_run(job, folder)


def drawing(job: Job, folder: Path) -> None:
    """Says which device would draw."""
    folder.mkdir()
    (folder / "drawn").write_text(f"{os.environ['MUJOCO_GL']} {os.environ['MUJOCO_EGL_DEVICE_ID']}")


def slow(job: Job, folder: Path) -> None:
    """Takes half a second, and says that it is at work."""
    folder.mkdir()
    (folder / f"{os.getpid()}.pid").touch()
    time.sleep(0.5)
    (folder / f"{os.getpid()}.pid").unlink()
    folder.rmdir()
    write_run(job, folder)


def lasting(job: Job, folder: Path) -> None:
    """Takes a minute, but for the first seed, and says that it is at work."""
    folder.mkdir()
    if job.seed:
        (folder / f"{os.getpid()}.pid").touch()
        time.sleep(60.0)


def deadly(job: Job, folder: Path) -> None:
    """Dies at the second seed."""
    if job.seed == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    write_run(job, folder)


def on_a_node(job: Job, folder: Path) -> None:
    """Says which Ray node it runs on; where it is asked to, it kills its Ray worker at the second seed."""
    node = Path(f"/proc/{_parent(os.getppid())}")
    (Path(os.environ["NODES"]) / node.name).touch()
    time.sleep(0.5)
    if job.seed == 1 and (Path(os.environ["NODES"]) / "deadly").exists():
        os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(10.0)
    write_run(job, folder)


def _parent(pid: int) -> int:
    """The process that started another one: of a Ray worker, its node."""
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


def refusing(job: Job, folder: Path) -> None:
    raise PlanError(f"Seed {job.seed} is not liked; take another.")


def write_run(job: Job, folder: Path) -> None:
    rng = np.random.default_rng([job.start, job.seed, len(job.policy), len(job.scene_name)])
    folder.mkdir()
    steps = np.arange(0, job.steps + 1, 10)
    ratio = 95.0 * (1.0 - np.exp(-steps * rng.uniform(0.01, 0.03)))
    rows = [
        f"{s},{r!r},{100.0 - r!r},{r + 4.0!r},{0.04 * s!r}" for s, r in zip(steps.tolist(), ratio.tolist(), strict=True)
    ]
    (folder / "curve.csv").write_text(
        "step,completion_ratio,completion_cm,observable_ratio,path_m\n" + "\n".join(rows) + "\n"
    )
    metrics = {
        "completion_ratio": ratio[-1],
        "observable_ratio": ratio[-1] + 4.0,
        "steps": int(steps[-1]),
        "turns": int(rng.integers(50)),
        "collisions": 0,
        "wall_s": time.perf_counter(),
        "hz": time.perf_counter(),
        "stage_hz": {"map": time.perf_counter()},
        "stop_reason": "BUDGET",
    }
    (folder / "metrics.json").write_text(json.dumps(metrics))
    actions = ["MOVE_FORWARD" if step % 3 else "TURN_LEFT" for step in range(job.steps)]
    log = [
        {"step": k + 1, "action": name, "collided": False, "moved_m": 0.065 * (name == "MOVE_FORWARD")}
        | {"x_m": 0.01 * k, "y_m": 0.002 * k * len(job.policy), "yaw_rad": 0.0}
        for k, name in enumerate(actions)
    ]
    (folder / "steps.jsonl").write_text("".join(json.dumps(line) + "\n" for line in log))
    plans = [{"step": 0, "ms": {}}, {"step": 27, "ms": {"graph": 8.0, "gain": 4.0}}]
    (folder / "plans.jsonl").write_text("".join(json.dumps(plan) + "\n" for plan in plans))
    (folder / "manifest.json").write_text(json.dumps({"git": {"revision": "0123456789abcdef", "changed": False}}))
