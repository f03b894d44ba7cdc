"""Whether two revisions behave alike: both make the same short runs, which must agree but for times.

    python scripts/compare_behaviour.py record runs/after
    python scripts/compare_behaviour.py record runs/before --program ../before/.venv/bin/anm-mj
    python scripts/compare_behaviour.py compare runs/before runs/after

Twelve runs: three scenes, four policies, both drives. Steps, decisions (but for their wording), curve, trajectory and
mesh are compared byte for byte; metrics without times and memory. Keys that were renamed are compared under their
present name. A difference ends with status 1.
"""

from __future__ import annotations

import csv
import itertools
import json
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any

import tyro

from anm_mj.evaluation.metrics import FORMER_KEYS

SCENES = ("flat", "home", "office")
POLICIES = ("gvg", "anm-s", "frontier", "oracle")
DRIVES = ("kinematic", "physics")
RENAMED = {"unseen": "unexplored", **FORMER_KEYS}
"""Keys of ``steps.jsonl``, ``plans.jsonl``, ``curve.csv`` and ``metrics.json``, former to present."""
TIMES = frozenset({"ms", "stage_hz", "wall_s", "hz", "evaluation_s", "peak_rss_mib"})
"""What differs from run to run."""
WORDING = frozenset({"reason"})


def record(
    out: Annotated[Path, tyro.conf.Positional],
    program: Path | None = None,
    steps: int = 80,
    only: tuple[str, ...] = (),
    settings: tuple[str, ...] = (),
) -> None:
    """Make the runs.

    Args:
        out: folder for one run folder each.
        program: the ``anm-mj`` of the checkout to be recorded; by default the one beside this Python.
        steps: budget of each run.
        only: names of the runs to make, such as ``home-gvg-physics``; all by default.
        settings: settings of every run, such as ``planning.geometry=occupancy``.
    """
    for k, (scene, policy) in enumerate(itertools.product(SCENES, POLICIES)):
        # Shifted by one from scene to scene, so that every policy meets both drives.
        drive = DRIVES[(k // len(POLICIES) + k) % 2]
        folder = out / f"{scene}-{policy}-{drive}"
        if only and folder.name not in only:
            continue
        options = ["--policy", policy, "--drive", drive, "--steps", str(steps), "--out", str(folder)]
        options += [text for setting in settings for text in ("--set", setting)]
        explore = [program or Path(sys.executable).with_name("anm-mj"), "explore", scene, *options]
        subprocess.run(explore, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        print(folder.name)


def compare(before: Annotated[Path, tyro.conf.Positional], after: Annotated[Path, tyro.conf.Positional]) -> None:
    """Compare two recordings and say where they differ."""
    names = sorted(path.name for path in before.iterdir())
    missing = [name for name in names if not (after / name).is_dir()]
    found = [f"{name}: not recorded in {after}" for name in missing]
    for name in names:
        if name not in missing:
            found += [f"{name}: {text}" for text in differences(before / name, after / name)]
    print("\n".join(found) or f"{len(names)} runs behave alike")
    sys.exit(bool(found))


def differences(before: Path, after: Path) -> list[str]:
    """Where two run folders differ, one line per file."""
    found = []
    for file, read in (
        ("steps.jsonl", lambda path: _json_rows(path, TIMES)),
        ("plans.jsonl", lambda path: _json_rows(path, TIMES | WORDING)),
        ("curve.csv", _csv_rows),
        ("metrics.json", lambda path: sorted(_renamed(json.loads(path.read_text()), TIMES).items())),
        ("trajectory.tum", lambda path: path.read_text().splitlines()),
        ("mesh.ply", lambda path: [path.read_bytes()]),
    ):
        a, b = read(before / file), read(after / file)
        if a != b:
            at = next((k for k, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b)))
            found.append(f"{file} differs from entry {at} on ({len(a)} and {len(b)} entries)")
    return found


def _json_rows(path: Path, left_out: frozenset[str]) -> list[str]:
    return [json.dumps(_renamed(json.loads(line), left_out)) for line in path.read_text().splitlines()]


def _csv_rows(path: Path) -> list[list[str]]:
    header, *rows = csv.reader(path.read_text().splitlines())
    return [[RENAMED.get(name, name) for name in header], *rows]


def _renamed(row: dict[str, Any], left_out: frozenset[str]) -> dict[str, Any]:
    return {RENAMED.get(key, key): value for key, value in row.items() if key not in left_out}


if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict({"record": record, "compare": compare})
