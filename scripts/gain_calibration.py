"""Prints how far the gain that the policy gvg expected came true: by kind of place, by scene, and by all.

    python scripts/gain_calibration.py runs/latest bench/tune
    OMP_NUM_THREADS=1 python scripts/gain_calibration.py --scenes home office residence --starts 3

Takes run folders and outputs of ``anm-mj bench``, and runs scenes itself, on the occupancy grid alone
(``scripts/bench_planner.py``), which takes seconds each. The kind is the one that most was expected of. What was
expected is the part of each target's promise that the robot then looked at; what it left on the way does not count. The
last column holds the whole promise of the targets that were judged, those not left on the way, against what they
brought.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import tyro
from msgspec import Struct

from anm_mj.bench.statistics import grouped
from anm_mj.cli.command_line import run_script
from anm_mj.errors import AnmError
from anm_mj.events import Decided, On
from anm_mj.io.jsonl import read_jsonl
from anm_mj.io.read_run import read_json
from anm_mj.io.run_shapes import ManifestShape
from anm_mj.scene.folder import Scene, load_scene
from anm_mj.types import TargetOutcome
from anm_mj.utils.read_file import convert


class _Outcome(Struct):
    kind: str
    promised_m2: float
    expected_m2: float
    realised_m2: float
    judged: bool


class _Decision(Struct):
    """What counts of a line of ``plans.jsonl``."""

    closed: _Outcome | None = None


def main(
    folders: Annotated[tuple[Path, ...], tyro.conf.Positional] = (),
    scenes: tuple[str, ...] = (),
    steps: int = 300,
    starts: int = 1,
) -> None:
    """Sum up.

    Args:
        folders: Run folders, or output folders of ``anm-mj bench``.
        scenes: Names or folders of scenes to run.
        steps: Budget of actions of these runs.
        starts: From how many of each scene's own starts.
    """
    outcomes = [found for folder in folders for found in _outcomes(folder)]
    outcomes += [found for name in scenes for found in _runs(load_scene(name), steps, starts)]
    if not outcomes:
        of = ", ".join((*map(str, folders), *scenes)) or "nothing; name run folders, or scenes by --scenes"
        raise AnmError(f"No run in {of} has closed a target; gvg writes what each brought.")
    columns = "", "targets", "left on the way", "promised [m²]", "expected [m²]", "realised [m²]", "realised / expected"
    columns = *columns, "judged: realised / promised"
    print(f"| {' | '.join(columns)} |\n|{'---|' * len(columns)}")
    for title, key in (("kind", 1), ("scene", 0)):
        groups = grouped((str(found[key]), found[2]) for found in outcomes)
        for name in sorted(groups):
            _print_row(f"{title} {name}", groups[name])
    _print_row("all", [outcome for *_, outcome in outcomes])


def _runs(scene: Scene, steps: int, starts: int) -> Iterator[tuple[str, str, TargetOutcome]]:
    """The same as :func:`_outcomes` of new runs from the first starts of a scene."""
    from bench_planner import run

    closed: list[TargetOutcome | None] = []
    keep = On(Decided, lambda event: closed.append(event.plan.closed))
    for pose in scene.starts[:starts]:
        run(scene, "gvg", steps, pose, 0, observers=(keep,))
    yield from ((scene.name, outcome.kind, outcome) for outcome in closed if outcome is not None)


def _outcomes(folder: Path) -> Iterator[tuple[str, str, _Outcome]]:
    """Scene, kind and outcome of each target that was closed in the runs of a folder."""
    for path in sorted([*folder.glob("plans.jsonl"), *folder.glob("runs/*/plans.jsonl")]):
        scene = convert(read_json(path.with_name("manifest.json")), ManifestShape).scene
        for line in read_jsonl(path):
            closed = convert(line, _Decision).closed
            if closed is not None:
                yield scene, closed.kind, closed


def _print_row(name: str, outcomes: Sequence[_Outcome | TargetOutcome]) -> None:
    promised, expected, realised = _sums(outcomes)
    judged = [outcome for outcome in outcomes if outcome.judged]
    of_judged, _, brought = _sums(judged)
    areas = " | ".join(f"{area:.1f}" for area in (promised, expected, realised))
    ratios = f"{_ratio(realised, expected)} | {_ratio(brought, of_judged)}"
    print(f"| {name} | {len(outcomes)} | {len(outcomes) - len(judged)} | {areas} | {ratios} |")


def _sums(outcomes: Sequence[_Outcome | TargetOutcome]) -> tuple[float, float, float]:
    """What targets promised, what was expected of them, and what they brought [m2]."""
    promised = sum(outcome.promised_m2 for outcome in outcomes)
    expected = sum(outcome.expected_m2 for outcome in outcomes)
    return promised, expected, sum(outcome.realised_m2 for outcome in outcomes)


def _ratio(part: float, whole: float) -> str:
    return f"{part / whole:.2f}" if whole > 0.0 else "-"


if __name__ == "__main__":
    run_script(main)
