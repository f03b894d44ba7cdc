"""Whether two revisions behave alike: both make the same short runs, which must agree but for times.

    python scripts/compare_behaviour.py record runs/after
    python scripts/compare_behaviour.py record runs/before --program ../before/.venv/bin/anm-mj
    python scripts/compare_behaviour.py compare runs/before runs/after

Seventeen runs: three scenes, four policies, both drives; a noisy camera, odometry, a run that was interrupted and
resumed, one that continues it, and its images mapped as a recorded sequence. Steps, decisions (but for their wording),
curve, trajectory and mesh are compared byte for byte; metrics without times and memory. Keys that were renamed are
compared under their present name. A difference ends with status 1.
"""

from __future__ import annotations

import csv
import itertools
import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Annotated, Any

import tyro

SCENES = ("flat", "home", "office")
POLICIES = ("gvg", "anm-s", "frontier", "oracle")
DRIVES = ("kinematic", "physics")
RENAMED = {"unseen": "unexplored"}
"""Keys of ``steps.jsonl``, ``plans.jsonl``, ``curve.csv`` and ``metrics.json``, old to present."""
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
        settings: settings of every run, such as ``mapping.geometry=occupancy``.
    """
    command = str(program or Path(sys.executable).with_name("anm-mj"))
    set_all = [text for setting in settings for text in ("--set", setting)]
    for name, arguments in jobs(out).items():
        if only and name not in only:
            continue
        options = ["--out", str(out / name), *set_all]
        if arguments[0] == "explore":
            options += ["--steps", str(steps)]
        interrupted = name.startswith("resumed")
        _make([command, *arguments, *options], out / name if interrupted else None, steps // 2)
        if interrupted:
            _make([command, "explore", "--resume", str(out / name)])
        print(name)


def jobs(out: Path) -> dict[str, list[str]]:
    """The arguments of every run by its name; the last ones go on from earlier ones in ``out``."""
    found = {}
    for k, (scene, policy) in enumerate(itertools.product(SCENES, POLICIES)):
        # Shifted by one from scene to scene, so that every policy meets both drives.
        drive = DRIVES[(k // len(POLICIES) + k) % 2]
        found[f"{scene}-{policy}-{drive}"] = ["explore", scene, "--policy", policy, "--drive", drive]
    found["home-d435i"] = ["explore", "home", "--sensor", "d435i"]
    found["home-odometry"] = ["explore", "home", "--pose", "odometry", "--set", "model.wheel_noise=0.02"]
    found["resumed-home"] = ["explore", "home", "--set", "record.images=full"]
    found["continued-home"] = ["explore", "home", "--continue", str(out / "resumed-home")]
    found["mapped-home"] = ["map", str(out / "resumed-home"), "--shadow"]
    return found


def _make(command: list[str], interrupt: Path | None = None, after_steps: int = 0) -> None:
    """Make a run, or interrupt it when its folder holds so many steps."""
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as running:
        while interrupt is not None and running.poll() is None:
            log = interrupt / "steps.jsonl"
            if log.is_file() and len(log.read_bytes().splitlines()) >= after_steps:
                running.send_signal(signal.SIGINT)
                break
            time.sleep(0.02)
        if running.wait() != 0:
            raise SystemExit(f"{' '.join(command)} ended with status {running.returncode}")


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
        if not (before / file).is_file() and not (after / file).is_file():
            continue
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
    return {RENAMED.get(key, key): value for key, value in row.items() if key not in left_out and value is not None}


if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict({"record": record, "compare": compare})
