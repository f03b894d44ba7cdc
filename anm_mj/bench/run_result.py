"""A finished run of a comparison, whole or cut at a shorter budget; anybody may have written it, so it is checked."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float
from msgspec import Meta, Struct
from msgspec.structs import asdict

from anm_mj.bench.executor import RESULT
from anm_mj.bench.job import Job, each_setting
from anm_mj.bench.statistics import grouped
from anm_mj.bench.worker import BOUND
from anm_mj.config import RunConfig
from anm_mj.errors import BenchError, RunFolderError
from anm_mj.evaluation.metrics import COUNTS, EpisodeStatistics, Metrics
from anm_mj.io.curve_file import COMPLETION_COLUMNS, read_curve
from anm_mj.io.jsonl import read_jsonl
from anm_mj.io.read_run import read_json
from anm_mj.io.run_shapes import Number
from anm_mj.planning.policies.registry import needs_truth
from anm_mj.types import FORWARD_STEP_M, Action
from anm_mj.utils.read_file import convert, read_text
from anm_mj.utils.settings import of_type

COMPLETION, OBSERVABLE, PATH = 1, 3, 4
"""Columns of a curve: completion ratio, completion ratio of the observable surface, and driven distance."""
MOST_MISSING = 0.1
"""A variant is drawn that lacks at most this share of all starts, or one: a run or two may have failed."""
OF_THE_WORLD = ("model.", "sensor.", "people.")
"""What the names of settings of the robot's body and sensors, and of the people beside it, begin with."""
UNKNOWN_REVISION = "unknown"
_METRICS = {field.name for field in fields(Metrics)}
_PER_CENT = ("_ratio", "_ratio_25mm", "_share", "_percent", "f_score")
_ANY_SIGN = ("_db", "_ssim", "people_nearest_m")
"""Of metrics below 0: discs of people and robot overlap a little in a contact."""
_ROUNDING = 1e-3
"""Numbers of two files agree to this, as a share of them or of 1."""


@dataclass(frozen=True)
class Result:
    """A finished run."""

    job: Job
    metrics: dict[str, Any]
    revision: str
    """Git revision; ends in ``+`` if the checkout had changes; ``unknown`` where the program was no checkout."""
    curve: Float[np.ndarray, "n 5"]
    """Step, completion ratio [%], completion [cm], observable ratio [%] (NaN where unknown), driven distance [m]."""
    folder: Path = Path()
    """Where it lies."""
    budget_by: str = ""
    """Name of the budget that the run is cut at, ``area`` or ``rooms``; empty where it has one budget only."""

    @property
    def variant(self) -> str:
        """Policy, with conditions and settings if these are not the defaults."""
        return self.job.variant

    @property
    def budget(self) -> int:
        """Budget of the run, or the shorter one that it is cut at [steps]."""
        return self.job.steps

    def steps_to(self, level: float) -> float:
        """First step of the curve at which the observable completion ratio reaches a level [%]; NaN if none."""
        reached = np.flatnonzero(self.curve[:, OBSERVABLE] >= level)
        return float(self.curve[reached[0], 0]) if len(reached) else float("nan")

    def path_m_to(self, level: float) -> float:
        """Distance driven until then [m]; where the level is never reached, as much as the budget allows.

        The limit is the same for all, else a robot that stands still would come first.
        """
        steps = self.steps_to(level)
        if not np.isfinite(steps):
            return FORWARD_STEP_M * self.budget
        return float(np.interp(steps, *self.curve[:, [0, PATH]].T))

    def area_under_curve(self, column: int) -> float:
        """Mean of a column of the curve over the budget; a run that ends early keeps its final value."""
        steps = np.append(self.curve[:, 0], self.budget)
        values = np.append(self.curve[:, column], self.curve[-1, column])
        return float(np.trapezoid(values, steps) / self.budget)

    def trajectory_xy_m(self) -> Float[np.ndarray, "n 2"]:
        """Where the robot was, from its start on [m]. Raises BenchError if the log of its steps is damaged."""
        with reading_run(self.folder):
            steps = [convert(line, _Step) for line in read_jsonl(self.folder / "steps.jsonl")[: self.budget]]
        return np.array([self.job.start_pose[:2], *((step.x_m, step.y_m) for step in steps)])

    def decisions_ms(self) -> list[float]:
        """How long each decision took [ms]. Raises BenchError if the log of decisions is damaged."""
        with reading_run(self.folder):
            decisions = [convert(line, _Decision) for line in read_jsonl(self.folder / "plans.jsonl")]
        return [sum(decision.ms.values()) for decision in decisions if decision.ms]

    def upper_bound(self) -> Float[np.ndarray, "n 2"] | None:
        """Step, and the estimated upper bound of what is covered by then [%]; None for runs that no oracle made. Raises
        BenchError if the file is damaged.
        """
        path = self.folder / BOUND
        if not path.exists():
            return None
        with reading_run(self.folder):
            table = np.loadtxt(read_text(path).splitlines(), delimiter=",", skiprows=1, ndmin=2)
            if table.shape[1:] != (2,) or not len(table) or not np.isfinite(table).all():
                raise ValueError(f"{path.name} has no two columns of numbers")
            return table

    @functools.cached_property
    def cuts(self) -> list[Result]:
        """The run at each budget of its comparison, or itself alone. Raises BenchError if its log is damaged."""
        return [self._cut(name, steps) for name, steps in self.job.cuts] or [self]

    def _cut(self, name: str, steps: int) -> Result:
        """The run as if it had ended at a shorter budget; facts that only its end tells are None."""
        job = replace(self.job, steps=steps)
        if self.curve[-1, 0] <= steps:
            return replace(self, job=job, budget_by=name)
        curve = self.curve[self.curve[:, 0] <= steps]
        log = EpisodeStatistics()
        with reading_run(self.folder):
            for line in read_jsonl(self.folder / "steps.jsonl")[:steps]:
                step = convert(line, _Step)
                log = log.after(Action[step.action], step.collided, step.moved_m, {})
        last = dict(zip(COMPLETION_COLUMNS, curve[-1], strict=True))
        del last["step"]
        metrics = {key: None for key in self.metrics if key != "stage_hz"} | last
        metrics |= {"observable_share": self.metrics.get("observable_share"), "stop_reason": "BUDGET"}
        metrics |= {key: getattr(log, key) for key in COUNTS}
        return replace(self, job=job, metrics=metrics, curve=curve, budget_by=name)


class _Step(Struct):
    """What counts of a line of ``steps.jsonl``."""

    action: str
    collided: bool
    moved_m: Number
    x_m: Number
    y_m: Number


class _Decision(Struct):
    """What counts of a line of ``plans.jsonl``."""

    ms: dict[str, float] | None = None


class _Git(Struct):
    revision: Annotated[str, Meta(pattern=r"^\w*$")] | None = None
    changed: bool = False


class _MadeBy(Struct):
    """What a manifest says of the program."""

    git: _Git | None = None


@contextmanager
def reading_run(folder: Path) -> Iterator[None]:
    """Name the run whose files cannot be read. Raises BenchError if the block raised an error of reading."""
    try:
        yield
    except (RunFolderError, OSError, ValueError, LookupError, TypeError) as err:
        raise BenchError(f"The run {folder} is damaged ({err}); delete it, and give the command again.") from err


def finished(jobs: Sequence[Job], runs: Path) -> list[Job]:
    """The jobs whose runs exist."""
    return [job for job in jobs if (runs / job.name / RESULT).is_file()]


def read_results(comparison: Path) -> list[Result]:
    """All finished runs of a comparison's folder, whichever there are. Raises BenchError if a run is damaged, or two
    differ in nothing but the contents of a policy's or a robot's file.
    """
    results = [read_result(path.parent) for path in sorted(comparison.glob(f"runs/*/{RESULT}"))]
    found: dict[str, Result] = {}
    for result in results:
        other = found.setdefault(replace(result.job, policy_hash="", robot_hash="").name, result)
        if other.job.name != result.job.name:
            raise BenchError(
                f"{other.folder} and {result.folder} are runs of two versions of {result.job.policy}, or of the robot; "
                "delete the folders of the older one."
            )
    return results


def read_result(folder: Path, of: Job | None = None) -> Result:
    """A finished run of a comparison. Raises BenchError if a file is damaged, or is of another run than ``of``."""
    manifest = folder / "manifest.json"
    with reading_run(folder):
        facts, metrics = read_json(folder / RESULT), read_json(folder / "metrics.json")
        job = convert(facts, Job)
        # Tables are written in UTF-8, which has no place for a half of a surrogate pair.
        json.dumps([facts, metrics], ensure_ascii=False).encode()
        for key, own in {} if of is None else of.facts.items():
            if job.facts[key] != own:
                raise ValueError(f"{RESULT} says {key} = {job.facts[key]!r}, but the folder's run has {own!r}")
        for name in filter(_METRICS.__contains__, metrics):
            of_type(Metrics, name, metrics[name])
        curve = _read_curve(folder / "curve.csv")
        _check_agreement(job, metrics, curve)
        made_by = convert(read_json(manifest) if manifest.is_file() else {}, _MadeBy)
    revision = revision_text(None if made_by.git is None else asdict(made_by.git))
    return Result(job, metrics, revision, curve, folder)


def _check_agreement(job: Job, metrics: Mapping[str, Any], curve: Float[np.ndarray, "n 5"]) -> None:
    """Raises ValueError for metrics that cannot be, or that are not those of the curve and the budget."""
    for name, value in metrics.items():
        if name not in _METRICS or isinstance(value, bool) or not isinstance(value, int | float):
            continue
        most = 100.0 if name.endswith(_PER_CENT) else math.inf
        if not (name.endswith(_ANY_SIGN) or 0.0 <= value <= most + _ROUNDING):
            raise ValueError(f"metrics.json says {name} = {value:g}; it goes from 0 to {most:g}")
    for name, last in zip(COMPLETION_COLUMNS, curve[-1].tolist(), strict=True):
        value = metrics.get(name)
        if name != "step" and value is not None and abs(value - last) > _ROUNDING * max(1.0, abs(last)):
            raise ValueError(f"metrics.json says {name} = {value:g}, but curve.csv ends with {last:g}")
    if curve[0, 0] != 0:
        raise ValueError(f"curve.csv begins at step {curve[0, 0]:.0f}")
    if curve[-1, 0] > job.steps:
        raise ValueError(f"curve.csv goes to step {curve[-1, 0]:.0f} of a run of {job.steps}")


def _read_curve(path: Path) -> Float[np.ndarray, "n 5"]:
    """The rows of a curve; raises ValueError where they say nothing of the completion."""
    columns = read_curve(path)
    if np.isnan(columns["completion_ratio"]).all():
        raise ValueError(f"{path.name} has no rows with a completion ratio")
    return np.stack([columns[name] for name in COMPLETION_COLUMNS], axis=1)


def revision_text(git: Mapping[str, Any] | None) -> str:
    """The entry ``git`` of a manifest in a few characters; ends in ``+`` if the checkout had changes."""
    if not git or not git.get("revision"):
        return UNKNOWN_REVISION
    return git["revision"][:12] + ("+" if git.get("changed") else "")


def by_budget(results: Sequence[Result]) -> dict[str, list[Result]]:
    """Runs by the name of the budget that they are cut at; a run that has several budgets stands under each. Raises
    BenchError if the log of a run's steps is damaged.
    """
    return grouped((cut.budget_by, cut) for result in results for cut in result.cuts)


def drawn_variants(results: Sequence[Result]) -> tuple[dict[str, list[Result]], int]:
    """The runs of those variants that ran from about all starts of all scenes, as far as all of them have made them,
    and how many variants did not.

    Means over other scenes, or from fewer starts, do not compare: a variant that lacks its hardest start would gain.
    """
    runs = grouped((result.variant, result) for result in results)
    starts = {name: {(run.job.scene_name, run.job.start) for run in own} for name, own in runs.items()}
    count = len(set().union(*starts.values()))
    # Where those that lack a start or two have none in common, those count that lack none.
    for most_missing in (max(1.0, MOST_MISSING * count), 0.0):
        drawn = [name for name in runs if count - len(starts[name]) <= most_missing]
        common = set.intersection(*(starts[name] for name in drawn)) if drawn else set()
        if common:
            kept = {
                name: [run for run in runs[name] if (run.job.scene_name, run.job.start) in common] for name in drawn
            }
            return kept, len(runs) - len(drawn)
    # Where none ran everywhere, all are drawn.
    return runs, 0


def compared(variants: Mapping[str, Sequence[Result]]) -> tuple[str, ...]:
    """The two variants whose spread is drawn: the default policy, and of the others that with the largest mean area.

    A policy that knows the building comes last.
    """

    def order(name: str) -> tuple[bool, bool, float]:
        areas = [run.area_under_curve(COMPLETION) for run in variants[name]]
        return name != RunConfig.policy, needs_truth(variants[name][0].job.policy), -float(np.mean(areas))

    return tuple(sorted(variants, key=order)[:2])


def split_settings(text: str) -> tuple[list[str], list[str]]:
    """Settings of the robot's body and sensors, such as its encoders' noise, and of people; and the others, from one
    text of the results table.
    """
    settings = each_setting(text)
    world = [setting for setting in settings if setting.startswith(OF_THE_WORLD)]
    return world, [setting for setting in settings if setting not in world]
