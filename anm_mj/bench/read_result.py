"""Reads the finished runs of a comparison, which anybody may have written, and checks them."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float
from msgspec import Meta, Struct
from msgspec.structs import asdict

from anm_mj.bench.executor import RESULT
from anm_mj.bench.job import Job
from anm_mj.bench.run_result import Result, reading
from anm_mj.evaluation.metrics import Metrics
from anm_mj.io.curve_file import COMPLETION_COLUMNS, read_curve
from anm_mj.io.read_run import read_json
from anm_mj.utils.read_file import convert
from anm_mj.utils.settings import of_type

UNKNOWN_REVISION = "unknown"
_METRICS = {field.name for field in fields(Metrics)}
_PER_CENT = ("_ratio", "_ratio_25mm", "_share", "_percent", "f_score")
_ANY_SIGN = ("_db", "_ssim")
_ROUNDING = 1e-3
"""Numbers of two files agree to this, as a share of them or of 1."""


class _Git(Struct):
    revision: Annotated[str, Meta(pattern=r"^\w*$")] | None = None
    changed: bool = False


class _MadeBy(Struct):
    """What a manifest says of the program."""

    git: _Git | None = None


def finished(jobs: Sequence[Job], runs: Path) -> list[Job]:
    """The jobs whose runs exist."""
    return [job for job in jobs if (runs / job.name / RESULT).is_file()]


def read_results(comparison: Path) -> list[Result]:
    """All finished runs of a comparison's folder, whichever there are. Raises BenchError if a run is damaged."""
    return [read_result(path.parent) for path in sorted(comparison.glob(f"runs/*/{RESULT}"))]


def read_result(folder: Path, of: Job | None = None) -> Result:
    """A finished run of a comparison. Raises BenchError if a file is damaged, or is of another run than ``of``."""
    manifest = folder / "manifest.json"
    with reading(folder):
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
