"""What an oracle's run takes from the other runs of its comparison, and the bound that it leaves beside its results."""

import os
from dataclasses import replace
from pathlib import Path

from anm_mj.bench.executor import RESULT
from anm_mj.bench.job import PLATFORM, Job
from anm_mj.bench.run_result import reading_run
from anm_mj.config import RunConfig
from anm_mj.evaluation.completion_curve import CHECKPOINT_STEPS
from anm_mj.evaluation.oracle.tour_annealing import MEASURES
from anm_mj.evaluation.oracle.tour_planner import TourPlanner
from anm_mj.io.read_run import read_json
from anm_mj.planning.policies.registry import needs_truth
from anm_mj.run_parts import make_parts
from anm_mj.utils.files import write_text
from anm_mj.utils.read_file import convert

_MEASURE = "policy.measure="
_SHARED = ("scene_hash", "start_pose", "robot_hash", *PLATFORM)
"""What a run must share with the oracle's for its poses to be worth a try."""


def turn_of(job: Job) -> int:
    """When a run is made, among those from its start: 0 for policies, then the oracle's tours, measure by measure.

    An oracle begins its search from what was made before.
    """
    if not needs_truth(job.policy):
        return 0
    named = [setting.removeprefix(_MEASURE) for setting in job.settings if setting.startswith(_MEASURE)]
    return 1 + (MEASURES.index(named[-1]) if named and named[-1] in MEASURES else 0)


def with_warm_start(config: RunConfig, job: Job, runs: Path) -> RunConfig:
    """The configuration of an oracle's run that also begins its search from what the runs before it have found, which
    lie in the folder ``runs`` of the comparison. Raises BenchError if one of these is damaged.
    """
    folders = []
    for path in sorted(runs.glob(f"[!.]*/{RESULT}")):
        with reading_run(path.parent):
            other = convert(read_json(path), Job)
        if turn_of(other) < turn_of(job) and all(other.facts[key] == job.facts[key] for key in _SHARED):
            folders.append(str(path.parent))
    return replace(config, policy_settings=replace(config.policy_settings, warm_start=os.pathsep.join(folders)))


def write_bound(config: RunConfig, path: Path) -> None:
    """Write the upper bound on what a run of the oracle can cover, at the steps of a completion curve. Raises AnmError
    if the scene cannot be used, and OSError if the file cannot be written.
    """
    with make_parts(config) as parts:
        pose = parts.robot.observe().pose
        assert parts.truth is not None
        bound = TourPlanner(parts.truth(), 1, pose).upper_bound(pose)
    lines = [
        f"{step},{float(bound[step])!r}" for step in sorted({*range(0, len(bound), CHECKPOINT_STEPS), len(bound) - 1})
    ]
    write_text(path, "step,observable_ratio\n" + "\n".join(lines) + "\n")
