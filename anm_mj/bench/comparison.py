"""A comparison, from its file to its tables; an interrupted one resumes."""

import itertools
import os
import shlex
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from anm_mj.bench.executor import UNFINISHED, run_jobs
from anm_mj.bench.figures import draw_curves, draw_overview, draw_scene
from anm_mj.bench.job import Job
from anm_mj.bench.oracle_run import turn_of
from anm_mj.bench.report_page import CARD, data_card, write_page
from anm_mj.bench.results_table import tidy_rows, write_csv
from anm_mj.bench.run_result import Result, by_budget, finished, read_result, revision_text
from anm_mj.bench.sweep import read_jobs
from anm_mj.bench.tables import markdown
from anm_mj.bench.worker import EXPLORE
from anm_mj.errors import BenchError
from anm_mj.io.folder_hold import lock
from anm_mj.io.manifest import git_revision
from anm_mj.io.run_folder import refuse_links
from anm_mj.scene.folder import load_scene
from anm_mj.utils.files import file_name, write_text
from anm_mj.utils.own_modules import let_import_from
from anm_mj.utils.package_data import checkout
from anm_mj.utils.read_file import read_text
from anm_mj.viz.figure_file import KINDS, PICTURE

TABLES_EVERY_S, TABLES_SHARE = 60.0, 0.02
"""While runs are made, tables are written this often [s], or less often if that would take more than this share of the
time."""
LOCK = ".lock"
"""Lock file in the comparison's folder; its writer holds the lock."""


@dataclass(frozen=True)
class Comparison:
    """Outcome of a comparison."""

    folder: Path
    jobs: list[Job]
    """All runs of the file."""
    skipped: int
    """Runs that existed already."""
    failures: list[str]
    """One sentence for each failed run; the next call tries them again."""

    @property
    def has_tables(self) -> bool:
        """Whether any run has ended: without one there are no tables."""
        return len(self.failures) < len(self.jobs)


def run_bench(
    file: Path,
    out: Path,
    *,
    num_workers: int = 1,
    executor: str = "local",
    command: Sequence[str] = (),
    function: str = EXPLORE,
    policies: Sequence[str] = (),
    one_revision: bool = False,
    egl_devices: Sequence[int] = (),
    on_run: Callable[[int, int, str], None] = lambda done, total, last: None,
) -> Comparison:
    """Make the missing runs, then write tables and pictures of all.

    Writes ``report.html`` (all in one page), ``results.csv`` (a row per run and budget), ``table.md``,
    ``data_card.md``, ``curves_<scene>`` (PNG, PDF, SVG), ``scene_<scene>.png``, ``overview.png`` and ``command.txt``;
    the runs lie in ``runs/``. Tables are also written from time to time, to look at while the comparison runs.

    Args:
        file: The TOML file (see :mod:`anm_mj.bench.sweep`).
        out: Folder of the comparison; made if missing.
        num_workers: Runs in parallel.
        executor: ``local`` or ``ray``.
        command: The command line, for the record.
        function: Function that makes a run, as ``module:function`` (see :func:`anm_mj.bench.executor.execute`).
        policies: Policies beside those of the file, in all sweeps without settings of their own.
        one_revision: Whether to refuse a folder that holds runs of another revision of this program.
        egl_devices: Numbers of the EGL devices that draw, which the runs take in turn; none = as the environment says.
        on_run: Called after every run with done and total runs and the last one's name or error.

    Raises:
        BenchError: The file, the executor or the folder cannot be used.
        SceneError: A scene cannot be found or read.
    """
    if num_workers < 1:
        raise BenchError(f"--workers is {num_workers}; at least 1 is needed.")
    # Policies of the user's own lie where the command is given, or beside the file.
    modules = tuple(dict.fromkeys((str(Path.cwd()), str(file.resolve().parent))))
    let_import_from(modules)
    jobs = read_jobs(file, policies)
    # The folders of this machine are private.
    text = shlex.join(Path(word).name if Path(word).is_absolute() else word for word in command)
    text = text or f'run_bench(Path("{file.name}"))'
    with _only_writer(out):
        there = finished(jobs, out / "runs")
        if one_revision:
            _check_revision(there, out)
        _prepare(jobs, file, out, text)
        missing = [job for job in jobs if job not in there]
        failures = []
        done, write_next_s = len(there), time.monotonic() + TABLES_EVERY_S
        on_run(done, len(jobs), "")
        for now in _stages(missing):
            workers = min(num_workers, len(now))
            for job, error in run_jobs(now, out / "runs", executor, workers, function, modules, egl_devices):
                done += error is None
                if error is not None:
                    failures.append(error)
                elif (begin_s := time.monotonic()) > write_next_s:
                    write_tables(jobs, out, text, (PICTURE,))
                    end_s = time.monotonic()
                    write_next_s = end_s + max(TABLES_EVERY_S, (end_s - begin_s) / TABLES_SHARE)
                on_run(done, len(jobs), error or job.name)
        write_tables(jobs, out, text)
    return Comparison(out, jobs, len(there), failures)


def _check_revision(there: Sequence[Job], out: Path) -> None:
    """Raises BenchError unless the runs that a folder holds were made by the program as it is now."""
    source = checkout()
    own = revision_text(None if source is None else git_revision(source))
    other = sorted({read_result(out / "runs" / job.name, job).revision for job in there} - {own})
    if other:
        raise BenchError(
            f"{out} holds runs of revision {', '.join(other)}, and this program is {own}; rows of one table must be "
            "of one revision. Give another --out, or delete the folder."
        )


@contextmanager
def _writable(out: Path) -> Iterator[None]:
    """Raises BenchError with the name of a file of a comparison that cannot be written within the block."""
    try:
        yield
    except OSError as err:
        path = err.filename2 or err.filename or out
        raise BenchError(
            f"{path} cannot be written ({err.strerror or err}); remove what is in its place, or give another --out."
        ) from err


@contextmanager
def _only_writer(out: Path) -> Iterator[None]:
    """Lock the folder against other comparisons; the system releases the lock however this one ends."""
    with _writable(out):
        out.mkdir(parents=True, exist_ok=True)
        # Anybody may have made what is there.
        refuse_links(out.resolve())
        file = os.fdopen(os.open(out / LOCK, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o666), "w")
    with file:
        if not lock(file.fileno()):
            raise BenchError(f"Another comparison is writing to {out}; wait until it ends, or give another --out.")
        yield


def _prepare(jobs: Sequence[Job], file: Path, out: Path, command: str) -> None:
    """Remove what unfinished runs left in the folder of a comparison, and note file and command there."""
    runs = out / "runs"
    with _writable(out):
        runs.mkdir(exist_ok=True)
        for unfinished in runs.glob(".*"):
            if UNFINISHED.fullmatch(unfinished.name):
                shutil.rmtree(unfinished, ignore_errors=True)
        for job in jobs:
            if (runs / job.name).exists() and not (runs / job.name).is_dir():
                raise BenchError(f"{runs / job.name} is no folder; remove it, or give another --out.")
        write_text(out / "command.txt", f"{command}\n")
        if file.resolve() != (out / "bench.toml").resolve():
            write_text(out / "bench.toml", read_text(file))


def _stages(jobs: Sequence[Job]) -> Iterator[list[Job]]:
    """Jobs in the order in which they are run, start by start, so that tables of a part compare all policies.

    The oracles of a start come last, tour after tour, because they begin from what the others have found.
    """

    def stage(job: Job) -> tuple[int, int]:
        return job.start, turn_of(job)

    for _, group in itertools.groupby(sorted(jobs, key=stage), key=stage):
        yield list(group)


def write_tables(jobs: Sequence[Job], out: Path, command: str, kinds: Sequence[str] = KINDS) -> None:
    """Write the tables and pictures of the existing runs; while the comparison goes on, no vector graphics. Raises
    BenchError if a file of a run is damaged, or one cannot be written.
    """
    results = [read_result(out / "runs" / job.name, job) for job in finished(jobs, out / "runs")]
    if not results:
        return
    with _writable(out):
        rows = tidy_rows(results)
        write_csv(out / "results.csv", rows)
        table = markdown(rows, command, len(jobs))
        write_text(out / "table.md", table)
        pictures = _draw(jobs, results, out, kinds)
        if kinds != KINDS:
            return
        title = f"Comparison {out.resolve().name}"
        card = data_card(rows, title, command)
        write_text(out / CARD, card)
        write_page(out, title, table, card, pictures)


def _draw(jobs: Sequence[Job], results: Sequence[Result], out: Path, kinds: Sequence[str]) -> dict[str, list[Path]]:
    """Draw the pictures of a comparison; returns those of each scene, and those of all under an empty name."""
    folders = {job.scene_name: job.scene for job in jobs}
    pictures: dict[str, list[Path]] = {"": []}
    for name in dict.fromkeys(result.job.scene_name for result in results):
        # A scene may call itself anything.
        own = file_name(name)
        cuts = by_budget([result for result in results if result.job.scene_name == name])
        pictures[name] = [
            draw_curves(out / f"curves_{own}{'_' * bool(by)}{by}.png", name, runs, kinds)[0]
            for by, runs in cuts.items()
        ]
        if kinds == KINDS:
            # At the first budget, which all variants have.
            runs = next(iter(cuts.values()))
            pictures[name] += draw_scene(out / f"scene_{own}.png", load_scene(folders[name]), runs)
    for by, runs in by_budget(results).items() if kinds == KINDS else ():
        pictures[""] += draw_overview(out / f"overview{'_' * bool(by)}{by}.png", runs)
    return pictures
