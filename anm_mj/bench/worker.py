"""One run of a comparison in a process of its own: ``python -m anm_mj.bench.worker MODULE:FUNCTION``.

The job comes as a line of JSON on the standard input. The parent keeps the input open while it lives; when the input
closes, the worker exits. So no worker outlives its parent, even after kill -9.
"""

import importlib
import json
import os
import sys
import threading
from dataclasses import replace
from pathlib import Path

from anm_mj.bench.job import Job
from anm_mj.errors import AnmError, BenchError
from anm_mj.planning.policies.registry import needs_truth, policy_hash
from anm_mj.utils.own_modules import let_import_from
from anm_mj.utils.read_file import convert

EXPLORE = "anm_mj.bench.worker:explore"
"""Default function that makes a run."""
BOUND = "upper_bound.csv"
"""File of an oracle's run: ``step,observable_ratio``, the estimated upper bound of what is covered by then [%]."""
KEPT = (
    "config.json",
    "curve.csv",
    "fixed_views.json",
    "manifest.json",
    "metrics.json",
    "novel_views.json",
    "plans.jsonl",
    "steps.jsonl",
    "topdown.png",
    BOUND,
)
"""Files kept of a run folder: metrics and logs, without frames, map and mesh."""
WITHOUT_PICTURES = "mlp"
"""The engine whose maps are not evaluated on views: they have no colours, and an image takes half a minute."""
FAILED = 2


def explore(job: Job, folder: Path) -> None:
    """Explore as the job says; the run folder has no large files. Raises AnmError if the run cannot be made."""
    from anm_mj.bench.oracle_run import with_warm_start, write_bound
    from anm_mj.evaluation.fixed_views import evaluate_fixed_views
    from anm_mj.evaluation.novel_views import evaluate_novel_views
    from anm_mj.evaluation.run_evaluation import add_views
    from anm_mj.run import run

    config = job.config()
    if needs_truth(job.policy):
        config = with_warm_start(config, job, folder.parent.parent)
    # What is for replay and exports would be deleted below.
    config = replace(config, record=replace(config.record, images="none", plans=False, replay_bytes=0))
    made, _ = run(config, out=folder)
    if job.views and job.trains and config.mapping.engine != WITHOUT_PICTURES:
        add_views(made.path, evaluate_novel_views(made.path), evaluate_fixed_views(made.path))
    if needs_truth(job.policy):
        write_bound(config, made.path / BOUND)
    for path in sorted(made.path.rglob("*"), reverse=True):
        if path.is_dir():
            path.rmdir()
        elif path.name not in KEPT:
            path.unlink()


def main(function: str) -> int:
    """Read a job from the standard input, execute it, and return the exit status."""
    line = json.loads(sys.stdin.readline())
    let_import_from(line["modules"])
    job = convert(line["job"], Job)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    module, _, name = function.partition(":")
    try:
        if policy_hash(job.policy) != job.policy_hash:
            raise BenchError(
                f"The module of {job.policy} was edited since the comparison began; give the command again."
            )
        getattr(importlib.import_module(module), name)(job, Path(line["folder"]))
    except AnmError as err:
        # The last line of the log is what the comparison reports.
        sys.stderr.write(f"{err}\n")
        return FAILED
    return 0


def _end_with_parent() -> None:
    sys.stdin.read()
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
