"""Executes the runs of a comparison: in processes on this machine, or as tasks of a Ray cluster.

Every run gets a process of its own. A process that dies costs its run and nothing else.
"""

import contextlib
import importlib.util
import itertools
import json
import logging
import os
import re
import shutil
import subprocess
import sys
import threading
import uuid
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path
from typing import Any

from anm_mj.bench.job import Job
from anm_mj.errors import BenchError

EXECUTORS = ("local", "ray")
_logger = logging.getLogger(__name__)

START_TRIES = 5
"""Tries to start a Ray cluster on this machine: Ray waits 15 s for its own helper process, which is too short on a busy
machine."""
RESULT = "result.json"
"""File in a run folder that is written last."""
LOG = "log.txt"
UNFINISHED = re.compile(r"\..+_[0-9a-f]{8}-[0-9a-f]{8}")
"""Names of the folders in which runs are made."""


def execute(
    job: Job,
    runs: str,
    function: str,
    threads: int,
    modules: Sequence[str],
    egl_device: int | None,
    start: Callable[..., subprocess.Popen[Any]] = subprocess.Popen,
) -> str | None:
    """Make one run in a process of its own; returns its error in one sentence, or None.

    The run folder gets its name once it is complete, so an aborted run never looks done.

    Args:
        job: The run.
        runs: Folder that gets the run folder.
        function: Function that makes the run, as ``module:function``; called with the job and an empty folder.
        threads: Threads for numerical libraries.
        modules: Folders to import modules from, besides the usual ones: those of the user's policies.
        egl_device: Number of the EGL device that draws; None = as the environment says.
        start: Starts the process.
    """
    attempt = Path(runs) / f".{job.name}-{uuid.uuid4().hex[:8]}"
    attempt.mkdir(parents=True)
    log = attempt / LOG
    environment = {**os.environ, "OMP_NUM_THREADS": str(threads)}
    if egl_device is not None:
        # egl alone: another back-end must not take the place of a device that is not there.
        environment |= {"MUJOCO_GL": "egl", "MUJOCO_EGL_DEVICE_ID": str(egl_device)}
    with log.open("wb") as output:
        process = start(
            [sys.executable, "-P", "-m", "anm_mj.bench.worker", function],
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=subprocess.STDOUT,
            env=environment,
        )
        assert process.stdin is not None
        try:
            order = json.dumps({"job": asdict(job), "folder": str(attempt / "run"), "modules": modules}) + "\n"
            process.stdin.write(order.encode())
            process.stdin.flush()
            status = process.wait()
        except BrokenPipeError:
            status = process.wait()
        except BaseException:
            process.kill()
            process.wait()
            raise
        finally:
            with contextlib.suppress(BrokenPipeError):
                process.stdin.close()
    if status != 0:
        lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        shutil.rmtree(attempt, ignore_errors=True)
        why = f"was killed by signal {-status}" if status < 0 else f"ended with status {status}"
        return f"{job.name} {why}" + (f": {lines[-1]}" if lines else ".")
    made = attempt / "run"
    (made / RESULT).write_text(json.dumps(job.facts, indent=2) + "\n", encoding="utf-8")
    log.replace(made / LOG)
    target = Path(runs) / job.name
    # Only an older version of this program can have left an incomplete folder here.
    shutil.rmtree(target, ignore_errors=True)
    made.replace(target)
    attempt.rmdir()
    return None


def run_jobs(
    jobs: list[Job],
    runs: Path,
    executor: str,
    num_workers: int,
    function: str,
    modules: Sequence[str] = (),
    egl_devices: Sequence[int] = (),
) -> Iterator[tuple[Job, str | None]]:
    """Make all runs, several in parallel; yields each with its error, or None, as it ends.

    The runs take the EGL devices in turn. Raises BenchError if there is no such executor, or Ray is not installed.
    """
    if not jobs and executor in EXECUTORS:
        return
    threads = max(1, (os.cpu_count() or 1) // num_workers)
    arguments = str(runs.resolve()), function, threads, tuple(modules)
    devices = itertools.cycle(egl_devices or (None,))
    if executor == "local":
        yield from _local(jobs, num_workers, arguments, devices)
    elif executor == "ray":
        yield from _ray(jobs, num_workers, arguments, devices)
    else:
        raise BenchError(f"There is no executor '{executor}'; choose one of {', '.join(EXECUTORS)}.")


def _local(
    jobs: list[Job], num_workers: int, arguments: tuple[str, str, int, tuple[str, ...]], devices: Iterator[int | None]
) -> Iterator[tuple[Job, str | None]]:
    begun: list[subprocess.Popen[Any]] = []
    is_over, alone = False, threading.Lock()

    def start(*command: Any, **options: Any) -> subprocess.Popen[Any]:
        with alone:
            if is_over:
                raise CancelledError
            begun.append(subprocess.Popen(*command, **options))
            return begun[-1]

    # The threads only wait for their processes.
    pool = ThreadPoolExecutor(num_workers)
    try:
        futures = {pool.submit(execute, job, *arguments, next(devices), start): job for job in jobs}
        for future in as_completed(futures):
            try:
                error = future.result()
            except OSError as err:
                error = f"{futures[future].name} could not be written ({err.strerror or err})."
            yield futures[future], error
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        # Where the comparison ends in an error, nobody waits for its runs, and the next one removes their folders.
        with alone:
            is_over = True
            for process in begun:
                process.kill()
        pool.shutdown()


def _ray(
    jobs: list[Job], num_workers: int, arguments: tuple[str, str, int, tuple[str, ...]], devices: Iterator[int | None]
) -> Iterator[tuple[Job, str | None]]:
    if importlib.util.find_spec("ray") is None:
        raise BenchError("--executor ray needs the package ray; install it with pip install 'anm-mj[ray]'.")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    import ray
    from ray.exceptions import RayError

    began = not ray.is_initialized()
    if began:
        # Join the cluster that the environment names; without one, start a cluster here. Ray would look for one by
        # itself, and find the note that a killed cluster left behind.
        known = os.environ.get("RAY_ADDRESS")
        local: dict[str, Any] = {} if known else {"num_cpus": num_workers, "include_dashboard": False}
        _started(lambda: ray.init(address=known or "local", log_to_driver=False, logging_level=logging.ERROR, **local))
    pending: dict[Any, Job] = {}
    try:
        remote = ray.remote(num_cpus=1, max_retries=0)(execute)
        pending |= {remote.remote(job, *arguments, next(devices)): job for job in jobs}
        while pending:
            (done,), _ = ray.wait(list(pending), num_returns=1)
            job = pending.pop(done)
            try:
                error = ray.get(done)
            except RayError as err:
                error = f"{job.name} was lost with its worker ({type(err).__name__})."
            yield job, error
    finally:
        for task in pending:
            ray.cancel(task, force=True)
        if began:
            ray.shutdown()


def _started(start: Callable[[], object]) -> None:
    """Start or join a cluster; raises BenchError where no try succeeds."""
    import ray

    failure: Exception | None = None
    for _ in range(START_TRIES):
        try:
            start()
            return
        except Exception as err:  # Ray has no exception class for a node that does not start.
            _logger.info("Ray did not start: %s", err)
            failure = err
            ray.shutdown()
    why = " ".join(str(failure).split())
    raise BenchError(f"Ray did not start in {START_TRIES} tries ({why}); try again when the machine is less busy.")
