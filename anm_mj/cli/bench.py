"""``anm-mj bench``: many runs, one table."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from anm_mj.cli.command_line import Option, Report
from anm_mj.cli.option_types import Count, NewFolder
from anm_mj.errors import ConfigError

INCOMPLETE = 1
"""Exit status if some runs failed."""


def bench(
    file: Path | None = None,
    *,
    suite: Annotated[str | None, Option("NAME")] = None,
    policy: Annotated[Sequence[str], Option("NAME")] = (),
    out: NewFolder | None = None,
    workers: Count = 1,
    executor: str = "local",
    egl_device: Annotated[Sequence[int], Option("N")] = (),
) -> Report:
    """Compare policies over scenes, starts and seeds, and write tables.

    The same command resumes an interrupted comparison. The exit status is 1 if runs failed.

    Args:
        file: a TOML file with scenes, policies, starts and seeds
        suite: a comparison of the package: smoke (minutes), tune, test (hours), variants (of policies), real (with all
            errors), large, people, open (scenes of others)
        policy: compare this policy too, by its name, or your own as module:Class; may be given several times
        out: folder; by default bench/<name of FILE or suite>
        workers: runs in parallel
        executor: local (processes) or ray (a cluster)
        egl_device: EGL device that draws, by its number in anm-mj doctor; of several, the runs take each in turn
    """
    if (file is None) == (suite is None):
        raise ConfigError("anm-mj bench takes a FILE or a --suite; give one of the two.")
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from anm_mj.bench.comparison import run_bench
    from anm_mj.bench.suite import suite_file
    from anm_mj.cli.console import PlainConsole

    console = PlainConsole()
    file = file or suite_file(suite or "")
    out = out or Path("bench") / file.stem
    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}", markup=False))
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=None)

        def show(done: int, total: int, last: str) -> None:
            progress.update(task, completed=done, total=total, description=last)
            if last and not console.is_terminal:
                console.say(f"{done}/{total} {last}")

        made = run_bench(
            file,
            out,
            num_workers=workers,
            executor=executor,
            policies=policy,
            one_revision=suite is not None,
            egl_devices=egl_device,
            command=["anm-mj", *sys.argv[1:]],
            on_run=show,
        )
    for failure in made.failures:
        PlainConsole(stderr=True).say(failure, style="red")
    left = f", {len(made.failures)} failed; the same command tries them again" if made.failures else ""
    files = {"report": out / "report.html", "table": out / "table.md", "results": out / "results.csv"}
    where = f"Report: {files['report']}; tables: {files['table']}, {files['results']}"
    if not made.has_tables:
        files, where = dict.fromkeys(files), "There are no tables yet."
    console.say(f"{len(made.jobs)} runs, {made.skipped} of them from before{left}. {where}")
    facts = {"runs": len(made.jobs), "from_before": made.skipped, "failures": made.failures, **files}
    return Report(facts, INCOMPLETE if made.failures else 0)
