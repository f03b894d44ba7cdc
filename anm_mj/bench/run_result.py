"""A finished run of a comparison, whole or cut at a shorter budget."""

from __future__ import annotations

import functools
import json
import math
import re
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
from anm_mj.bench.job import Job
from anm_mj.bench.sweep import BenchError
from anm_mj.bench.worker import BOUND
from anm_mj.errors import RunFolderError
from anm_mj.evaluation.metrics import COUNTS, EpisodeStatistics, Metrics
from anm_mj.io.curve_file import COLUMNS, read_curve
from anm_mj.io.jsonl import read_jsonl
from anm_mj.io.read_run import read_json
from anm_mj.io.run_shapes import Count, Number
from anm_mj.planning.policies.context import DEFAULT_GOAL
from anm_mj.robot.robot_config import DEFAULT_ROBOT
from anm_mj.types import FORWARD_STEP_M, Action
from anm_mj.utils.read_file import convert, read_text
from anm_mj.utils.settings import of_type

USUAL = {
    "preset": "default",
    "robot": DEFAULT_ROBOT,
    "drive": "kinematic",
    "pose": "true",
    "sensor": "exact",
    "goal": DEFAULT_GOAL,
}
"""What variant names leave out, and what runs had before there was a choice."""
COMPLETION, OBSERVABLE, PATH = 1, 3, 4
"""Columns of a curve: completion ratio, completion ratio of the observable surface, and driven distance."""
UNKNOWN_REVISION = "unknown"
MOST_MISSING = 0.1
"""A variant is drawn that lacks at most this share of all starts, or one: a run or two may have failed."""
OF_THE_ROBOT = ("model.", "sensor.", "motion.")
"""What the names of settings of the robot's body and sensors begin with."""
_METRICS = {field.name for field in fields(Metrics)}
_PER_CENT = ("_ratio", "_ratio_25mm", "_share", "_percent", "f_score")
_ANY_SIGN = ("_db", "_ssim")
_ROUNDING = 1e-3
"""Numbers of two files agree to this, as a share of them or of 1."""


class JobShape(Struct):
    """What ``result.json`` says of the run that was made."""

    scene_name: str
    scene_hash: str
    policy: str
    start: Count
    start_pose: tuple[Number, Number, Number]
    seed: int
    steps: Annotated[int, Meta(ge=1, le=10**9)]
    preset: str
    settings: list[str]
    sensor: str = USUAL["sensor"]
    robot: str = USUAL["robot"]
    drive: str = USUAL["drive"]
    pose: str = USUAL["pose"]
    goal: str = USUAL["goal"]
    cuts: list[tuple[str, Count]] = []


class _Done(Struct):
    """What counts of a line of ``steps.jsonl``."""

    action: str
    collided: bool
    moved_m: Number


class _Place(Struct):
    """Where the robot was after a line of ``steps.jsonl``."""

    x_m: Number
    y_m: Number


class _Git(Struct):
    revision: Annotated[str, Meta(pattern=r"^\w*$")] | None = None
    changed: bool = False


class _MadeBy(Struct):
    """What a manifest says of the program."""

    git: _Git | None = None


@dataclass(frozen=True)
class Result:
    """A finished run."""

    job: dict[str, Any]
    """Fields of :class:`~anm_mj.bench.job.Job`."""
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
        """Policy, with preset, robot, drive, pose, sensor, goal and settings if these are not the defaults."""
        return variant({**self.job, **self.conditions, "settings": " ".join(self.job["settings"])})

    @property
    def conditions(self) -> dict[str, str]:
        """Preset, robot, drive, pose, sensor and goal."""
        return {key: self.job.get(key, usual) for key, usual in USUAL.items()}

    @property
    def budget(self) -> int:
        """Budget of the run, or the shorter one that it is cut at [steps]."""
        return self.job["steps"]

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
        """Where the robot was, from its start on [m].

        Raises:
            BenchError: The log of its steps is damaged.
        """
        x_m, y_m, _ = self.job["start_pose"]
        with _of(self.folder):
            places = [convert(line, _Place) for line in read_jsonl(self.folder / "steps.jsonl")[: self.budget]]
        return np.array([(x_m, y_m), *((place.x_m, place.y_m) for place in places)])

    def bound(self) -> Float[np.ndarray, "n 2"] | None:
        """Step, and the estimated upper bound of what is covered by then [%]; None for runs that no oracle made."""
        path = self.folder / BOUND
        if not path.exists():
            return None
        with _of(self.folder):
            table = np.loadtxt(read_text(path).splitlines(), delimiter=",", skiprows=1, ndmin=2)
            if table.shape[1:] != (2,) or not len(table) or not np.isfinite(table).all():
                raise ValueError(f"{path.name} has no two columns of numbers")
            return table

    def at_budgets(self) -> list[Result]:
        """The run at each budget of its comparison; itself if there is one only.

        Raises:
            RunFolderError: The log of its steps is damaged.
        """
        return self._cuts

    @functools.cached_property
    def _cuts(self) -> list[Result]:
        return [self._cut(name, steps) for name, steps in self.job.get("cuts") or ()] or [self]

    def _cut(self, name: str, steps: int) -> Result:
        """The run as if it had ended after so many steps; what only its end tells is left out."""
        job = {**self.job, "steps": steps}
        if self.curve[-1, 0] <= steps:
            return replace(self, job=job, budget_by=name)
        curve = self.curve[self.curve[:, 0] <= steps]
        log = EpisodeStatistics()
        with _of(self.folder):
            for line in read_jsonl(self.folder / "steps.jsonl")[:steps]:
                done = convert(line, _Done)
                log = log.after(Action[done.action], done.collided, done.moved_m, {})
        metrics = {key: None for key in self.metrics if key != "stage_hz"} | {
            "completion_ratio": curve[-1, COMPLETION],
            "completion_cm": curve[-1, 2],
            "observable_ratio": curve[-1, OBSERVABLE],
            "observable_share": self.metrics.get("observable_share"),
            "path_m": curve[-1, PATH],
            "stop_reason": "BUDGET",
            **{key: getattr(log, key) for key in COUNTS},
        }
        return replace(self, job=job, metrics=metrics, curve=curve, budget_by=name)


def by_budget(results: Sequence[Result]) -> dict[str, list[Result]]:
    """Runs by the name of the budget that they are cut at; a run that has several budgets stands under each.

    Raises:
        RunFolderError: The log of a run's steps is damaged.
    """
    found: dict[str, list[Result]] = {}
    for result in results:
        for cut in result.at_budgets():
            found.setdefault(cut.budget_by, []).append(cut)
    return found


def of_all_starts(results: Sequence[Result]) -> tuple[list[Result], int]:
    """The runs of those variants that ran from about all starts of all scenes, and how many variants did not.

    Means over other scenes, or from fewer starts, do not compare.
    """
    starts: dict[str, set[tuple[str, int]]] = {}
    for result in results:
        starts.setdefault(result.variant, set()).add((result.job["scene_name"], result.job["start"]))
    count = len(set().union(*starts.values()))
    drawn = {name for name, own in starts.items() if count - len(own) <= max(1.0, MOST_MISSING * count)}
    # Where none ran everywhere, all are drawn.
    drawn = drawn or set(starts)
    return [result for result in results if result.variant in drawn], len(starts) - len(drawn)


def split_settings(text: str) -> tuple[list[str], list[str]]:
    """Settings of the robot's body and sensors, such as its encoders' noise, and the others.

    Args:
        text: Settings as one text, as in the results table; values may hold spaces.
    """
    settings = [setting for setting in re.split(r" (?=[\w.]+=)", text) if setting]
    robot = [setting for setting in settings if setting.startswith(OF_THE_ROBOT)]
    return robot, [setting for setting in settings if setting not in robot]


def variant(row: Mapping[str, Any]) -> str:
    """Name of a variant, such as ``anm-s (policy.target=random)``; its runs differ by start and seed.

    Args:
        row: Of the results table: ``policy``, the keys of ``USUAL``, and ``settings`` as one text.
    """
    special = [row[key] for key, usual in USUAL.items() if row[key] != usual]
    text = " ".join(text for text in (*special, row["settings"]) if text)
    return f"{row['policy']} ({text})" if text else row["policy"]


def read_result(folder: Path, of: Job | None = None) -> Result:
    """A finished run of a comparison.

    Args:
        folder: Where it lies.
        of: The run that it should be; None = whichever it says.

    Raises:
        BenchError: A file is damaged, or is of another run.
    """
    manifest = folder / "manifest.json"
    with _of(folder):
        job, metrics = read_json(folder / RESULT), read_json(folder / "metrics.json")
        convert(job, JobShape)
        # Tables are written in UTF-8, which has no place for a half of a surrogate pair.
        json.dumps([job, metrics], ensure_ascii=False).encode()
        if of is not None:
            _check_same(job, of)
        for field in fields(Metrics):
            if field.name in metrics:
                of_type(Metrics, field.name, metrics[field.name])
        curve = _read_curve(folder / "curve.csv")
        _check_agreement(job, metrics, curve)
        made_by = convert(read_json(manifest) if manifest.is_file() else {}, _MadeBy)
        return Result(
            folder=folder,
            job=job,
            metrics=metrics,
            revision=revision_text(None if made_by.git is None else asdict(made_by.git)),
            curve=curve,
        )


def _check_same(job: Mapping[str, Any], of: Job) -> None:
    """Raises ValueError for a run of something else than its folder's name stands for."""
    for key, own in json.loads(json.dumps(of.facts)).items():
        # Older versions wrote fewer facts.
        if job.get(key, own) != own:
            raise ValueError(f"{RESULT} says {key} = {job[key]!r}, but the folder's run has {own!r}")


def _check_agreement(job: Mapping[str, Any], metrics: Mapping[str, Any], curve: Float[np.ndarray, "n 5"]) -> None:
    """Raises ValueError for metrics that cannot be, or that are not those of the curve and the budget."""
    for name, value in metrics.items():
        if name not in _METRICS or isinstance(value, bool) or not isinstance(value, int | float):
            continue
        most = 100.0 if name.endswith(_PER_CENT) else math.inf
        if not (name.endswith(_ANY_SIGN) or 0.0 <= value <= most + _ROUNDING):
            raise ValueError(f"metrics.json says {name} = {value:g}; it goes from 0 to {most:g}")
    for name, last in zip(COLUMNS, curve[-1].tolist(), strict=True):
        value = metrics.get(name)
        if name != "step" and value is not None and abs(value - last) > _ROUNDING * max(1.0, abs(last)):
            raise ValueError(f"metrics.json says {name} = {value:g}, but curve.csv ends with {last:g}")
    if curve[0, 0] != 0:
        raise ValueError(f"curve.csv begins at step {curve[0, 0]:.0f}")
    if curve[-1, 0] > job["steps"]:
        raise ValueError(f"curve.csv goes to step {curve[-1, 0]:.0f} of a run of {job['steps']}")


def _read_curve(path: Path) -> Float[np.ndarray, "n 5"]:
    """The rows of a curve.

    Raises:
        RunFolderError: It cannot be read, or holds no curve.
        ValueError: It says nothing of the completion.
    """
    columns = read_curve(path)
    if np.isnan(columns["completion_ratio"]).all():
        raise ValueError(f"{path.name} has no rows with a completion ratio")
    return np.stack([columns[name] for name in COLUMNS], axis=1)


@contextmanager
def _of(folder: Path) -> Iterator[None]:
    """Say of whatever a run's files lead to which run it was.

    Raises:
        BenchError: the block raised an error of reading.
    """
    try:
        yield
    except (RunFolderError, OSError, ValueError, LookupError, TypeError) as err:
        raise BenchError(f"The run {folder} is damaged ({err}); delete it, and give the command again.") from err


def revision_text(git: Mapping[str, Any] | None) -> str:
    """The entry ``git`` of a manifest in a few characters; ends in ``+`` if the checkout had changes."""
    if not git or not git.get("revision"):
        return UNKNOWN_REVISION
    return git["revision"][:12] + ("+" if git.get("changed") else "")


def finished(jobs: Sequence[Job], runs: Path) -> list[Job]:
    """The jobs whose runs exist."""
    return [job for job in jobs if (runs / job.name / RESULT).is_file()]
