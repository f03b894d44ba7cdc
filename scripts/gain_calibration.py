"""Prints how far the gain that a policy expected came true, from finished runs: by kind of place, and by scene.

    anm-mj bench tune.toml --out bench/tune
    python scripts/gain_calibration.py bench/tune runs/latest

Takes run folders and outputs of ``anm-mj bench``. The kind is the one that most was expected of. Targets that the robot
left on the way for a better one do not count; their number stands beside those that do.
"""

from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import tyro
from msgspec import Struct

from anm_mj.cli.script import run_script
from anm_mj.errors import AnmError
from anm_mj.io.jsonl import read_jsonl
from anm_mj.io.read_run import read_json
from anm_mj.io.run_shapes import ManifestShape
from anm_mj.utils.read_file import convert


class _Outcome(Struct):
    kind: str
    expected_m2: float
    realised_m2: float
    judged: bool


class _Decision(Struct):
    """What counts of a line of ``plans.jsonl``."""

    closed: _Outcome | None = None


def main(folders: Annotated[tuple[Path, ...], tyro.conf.Positional]) -> None:
    """Sum up.

    Args:
        folders: Run folders, or output folders of ``anm-mj bench``.
    """
    outcomes = [found for folder in folders for found in _outcomes(folder)]
    if not outcomes:
        raise AnmError(f"No run in {', '.join(map(str, folders))} has closed a target; gvg writes what each brought.")
    columns = "", "targets", "left on the way", "expected [m²]", "realised [m²]", "realised / expected"
    print(f"| {' | '.join(columns)} |\n|{'---|' * len(columns)}")
    for title, key in (("kind", 1), ("scene", 0)):
        groups: dict[str, list[_Outcome]] = defaultdict(list)
        for found in outcomes:
            groups[str(found[key])].append(found[2])
        for name in sorted(groups):
            _print_row(f"{title} {name}", groups[name])
    _print_row("all", [outcome for *_, outcome in outcomes])


def _outcomes(folder: Path) -> Iterator[tuple[str, str, _Outcome]]:
    """Scene, kind and outcome of each target that was closed in the runs of a folder."""
    for path in sorted([*folder.glob("plans.jsonl"), *folder.glob("runs/*/plans.jsonl")]):
        scene = convert(read_json(path.with_name("manifest.json")), ManifestShape).scene
        for line in read_jsonl(path):
            closed = convert(line, _Decision).closed
            if closed is not None:
                yield scene, closed.kind, closed


def _print_row(name: str, outcomes: list[_Outcome]) -> None:
    judged = [outcome for outcome in outcomes if outcome.judged]
    expected, realised = (sum(getattr(o, key) for o in judged) for key in ("expected_m2", "realised_m2"))
    ratio = f"{realised / expected:.2f}" if expected > 0.0 else "-"
    print(f"| {name} | {len(judged)} | {len(outcomes) - len(judged)} | {expected:.1f} | {realised:.1f} | {ratio} |")


if __name__ == "__main__":
    run_script(main)
