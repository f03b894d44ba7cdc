"""``anm-mj bench``: many runs, one table."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from anm_mj.cli.option_types import place

INCOMPLETE = 1
"""Exit status if some runs failed."""


def add_bench(commands: Any) -> None:
    """Add ``bench`` to the commands of the program."""
    bench = commands.add_parser(
        "bench",
        help="compare policies over scenes, starts and seeds, and write tables",
        epilog="The same command resumes an interrupted comparison.",
    )
    what = bench.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "file", type=Path, nargs="?", metavar="FILE", help="a TOML file with scenes, policies, starts and seeds"
    )
    what.add_argument(
        "--suite",
        metavar="NAME",
        help="a comparison of the package: smoke (minutes), tune, test (hours), large, open (scenes of others)",
    )
    bench.add_argument(
        "--policy",
        action="append",
        default=[],
        metavar="NAME",
        help="compare this policy too, as module:Class your own; may be given several times",
    )
    bench.add_argument("--out", type=place, metavar="DIR", help="folder (default: bench/<name of FILE or suite>)")
    bench.add_argument("--workers", type=int, default=1, metavar="N", help="runs in parallel (default: 1)")
    bench.add_argument("--executor", default="local", help="local (processes) or ray (a cluster) (default: local)")
    bench.set_defaults(command=_bench)


def _bench(parsed: argparse.Namespace) -> int:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from anm_mj.bench.comparison import run_bench
    from anm_mj.bench.suite import suite_file
    from anm_mj.cli.console import PlainConsole

    console = PlainConsole()
    file = suite_file(parsed.suite) if parsed.suite is not None else parsed.file
    out = parsed.out or Path("bench") / file.stem
    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}", markup=False))
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=None)

        def show(done: int, total: int, last: str) -> None:
            progress.update(task, completed=done, total=total, description=last)
            if last and not console.is_terminal:
                console.print(f"{done}/{total} {last}", highlight=False, soft_wrap=True)

        bench = run_bench(
            file,
            out,
            num_workers=parsed.workers,
            executor=parsed.executor,
            policies=parsed.policy,
            one_revision=parsed.suite is not None,
            command=["anm-mj", *sys.argv[1:]],
            on_run=show,
        )
    errors = PlainConsole(stderr=True)
    for failure in bench.failures:
        errors.print(failure, style="red", highlight=False, soft_wrap=True)
    left = f", {len(bench.failures)} failed; the same command tries them again" if bench.failures else ""
    console.print(
        f"{len(bench.jobs)} runs, {bench.skipped} of them from before{left}. "
        f"Report: {out / 'report.html'}; tables: {out / 'table.md'}, {out / 'results.csv'}",
        highlight=False,
        soft_wrap=True,
    )
    return INCOMPLETE if bench.failures else 0
