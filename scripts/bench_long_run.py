"""Measures whether a long run stays as quick and as small as it was: steps, memory and disk, thousand by thousand.

    python scripts/bench_long_run.py aws_hospital --steps 20000 --out runs/long --figure long.png
    python scripts/bench_long_run.py aws_hospital --reality real
    python scripts/bench_long_run.py white_room --policy random --steps 10000

The run is one of ``anm-mj explore --goal both``, recording included. "ms" is the median wall time of a step, "CPU" the
mean processor time of all threads. Memory is what the process holds after freed memory was given back, at every
hundredth step: the least and the most of a thousand's ten readings, because what drawing takes comes and goes with the
view, by tens of megabytes. Growth is that of the least, from the step at which the coverage of the observable surface
last grew by a point.
"""

import gc
import json
import math
import os
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

import anm_mj
from anm_mj.cli.command_line import run_script
from anm_mj.utils.memory import malloc_trim

PART = 1000
"""Steps of a row."""
READING = 100
"""Steps between two readings of the memory."""


@dataclass
class Row:
    """What the steps of one part cost."""

    step: int
    """The last of them."""
    covered: float
    """Of the observable surface by then [%]."""
    step_ms: float
    """Median wall time of a step."""
    cpu_ms: float
    """Mean processor time of a step, all threads."""
    rss_mib: float
    """Memory that is kept: the least reading."""
    most_rss_mib: float
    disk_mib: float
    """Size of the run folder, checkpoints included."""


class Meter:
    """Notes the cost of every part of a run."""

    def __init__(self, out: Path) -> None:
        """Before the run, whose folder is ``out``."""
        self.rows: list[Row] = []
        self._out = out
        self._wall_s: list[float] = []
        self._rss_mib: list[float] = []
        self._cpu_s = time.process_time()
        self._unmeasured_s = 0.0
        """Processor time of the readings."""

    def step(self, report: Any) -> None:
        """Note the end of a step."""
        self._wall_s.append(time.perf_counter())
        if report.step == 0 or report.step % READING:
            return
        cpu_s = time.process_time()
        gc.collect()
        malloc_trim()
        self._rss_mib.append(rss_mib())
        self._unmeasured_s += time.process_time() - cpu_s
        if report.step % PART:
            return
        self.rows.append(
            Row(
                report.step,
                float("nan"),
                1e3 * float(np.median(np.diff(self._wall_s[-PART - 1 :]))),
                1e3 * (time.process_time() - self._cpu_s - self._unmeasured_s) / PART,
                min(self._rss_mib),
                max(self._rss_mib),
                folder_mib(self._out),
            )
        )
        self._cpu_s, self._unmeasured_s, self._rss_mib = time.process_time(), 0.0, []
        print(f"step {report.step}: {self.rows[-1].step_ms:.1f} ms, {self.rows[-1].rss_mib:.0f} MiB", flush=True)


def rss_mib() -> float:
    """Memory that the process holds now [MiB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def folder_mib(folder: Path) -> float:
    """Size of all files below a folder [MiB]; without a path of each, whose names Python would keep a table of."""
    return sum(os.stat(os.path.join(at, name)).st_size for at, _, names in os.walk(folder) for name in names) / 2**20


def growth_mib(rows: list[Row]) -> float:
    """Memory that a thousand steps add once the scene is covered [MiB]: the slope of a line through those rows."""
    covered = [row for row in rows if row.covered >= rows[-1].covered - 1.0]
    if len(covered) < 3:
        return float("nan")
    slope, _ = np.polyfit([row.step / PART for row in covered], [row.rss_mib for row in covered], 1)
    return float(slope)


def draw(rows: list[Row], title: str, path: Path) -> None:
    """Draw the four curves over the steps."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 6.0), dpi=110, layout="constrained")
    steps = [row.step for row in rows]
    quantities = (("covered", "observable surface covered [%]"), ("cpu_ms", "processor's time of a step [ms]"))
    quantities += (("rss_mib", "memory [MiB]"), ("disk_mib", "run folder [MiB]"))
    for axes, (name, label) in zip(figure.subplots(2, 2).flat, quantities, strict=True):
        axes.plot(steps, [getattr(row, name) for row in rows], marker=".")
        axes.set(xlabel="step", ylabel=label, ylim=(0, None))
        axes.grid(alpha=0.3)
    figure.suptitle(f"{title}, {steps[-1]} steps")
    figure.savefig(path)


def main(
    scene: Annotated[str, tyro.conf.Positional],
    steps: int = 20_000,
    policy: str = "gvg",
    reality: str = "ideal",
    out: Path = Path("runs/long"),
    figure: Path | None = None,
    json_file: Annotated[Path | None, tyro.conf.arg(name="json")] = None,
) -> None:
    """Measure and print.

    Args:
        scene: name or folder of a scene.
        steps: budget.
        policy: who explores.
        reality: the world and its errors.
        out: the run folder.
        figure: where the curves are drawn.
        json_file: where the rows go too.
    """
    meter = Meter(out)
    anm_mj.explore_scene(scene, policy=policy, steps=steps, reality=reality, out=out, on_step=meter.step)
    curve = np.genfromtxt(out / "curve.csv", delimiter=",", names=True)
    for row in meter.rows:
        row.covered = float(np.interp(row.step, curve["step"], curve["observable_ratio"]))
    table = Table("step", "covered %", "ms", "CPU ms", "memory MiB", "most MiB", "disk MiB")
    for row in meter.rows:
        figures = (row.covered, row.step_ms, row.cpu_ms, row.rss_mib, row.most_rss_mib, row.disk_mib)
        table.add_row(str(row.step), *(f"{value:.1f}" for value in figures))
    Console().print(table)
    growth = growth_mib(meter.rows)
    if math.isfinite(growth):
        print(f"memory grows by {growth:.2f} MiB per {PART} steps once the scene is covered")
    if figure is not None:
        draw(meter.rows, f"{scene}, {policy}, {reality} world", figure)
    if json_file is not None:
        json_file.write_text(json.dumps([asdict(row) for row in meter.rows], indent=2) + "\n")


if __name__ == "__main__":
    run_script(main)
