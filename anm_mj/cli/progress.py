"""A run in the terminal: one live line during the run, a table of metrics at its end."""

from __future__ import annotations

import math
import signal
from pathlib import Path
from types import FrameType

from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from anm_mj.evaluation.metrics import Metrics
from anm_mj.explore import StepReport
from anm_mj.io.recorder import RunRecorder

PLAIN_EVERY = 50
"""Steps between two printed lines, if the output is no terminal."""


class ProgressLine:
    """One live line: step, rate, completion ratio, target, loss, reason. Without a terminal, plain lines."""

    def __init__(self, console: Console):
        """Nothing is shown before the first step."""
        self._console = console
        self._loss = math.nan
        self._live = Live(console=console, refresh_per_second=4, transient=True) if console.is_terminal else None

    def __enter__(self) -> ProgressLine:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def surveying(self, done: int, total: int) -> None:
        """Show the progress of the computation of the observable surface."""
        if self._live is not None:
            self._live.update(Text(f"computing the observable surface (once per scene): {100 * done // total} %"))
        elif done == 1:
            self._console.print("Computing the observable surface (once per scene).")

    def update(self, report: StepReport, recorder: RunRecorder, num_steps: int) -> None:
        """Show how the run stands."""
        if report.update.num_iterations:  # Not every step trains.
            self._loss = report.update.loss
        if self._live is None and report.step % PLAIN_EVERY and report.step != num_steps:
            return
        target = report.plan.target_xy_m
        row = recorder.completion
        parts = [
            f"step {report.step}/{num_steps}",
            f"{report.step / max(report.loop_s, 1e-9):.1f} Hz",
            f"completion {row.completion_ratio:.1f} %" if row is not None else "",
            f"target {target[0]:.1f},{target[1]:.1f}" if target is not None else "",
            f"loss {self._loss:.3g}",
            report.plan.reason,
        ]
        line = " · ".join(part for part in parts if part)
        if self._live is None:
            self._console.print(line, highlight=False, soft_wrap=True)
        else:
            self._live.update(Text(line, no_wrap=True, overflow="ellipsis"))


class Interrupt:
    """The first Ctrl-C ends the run after its present step, the second ends the program."""

    def __init__(self, console: Console):
        """Nothing is requested yet."""
        self._console = console
        self._requested = False

    def __enter__(self) -> Interrupt:
        self._former = signal.signal(signal.SIGINT, self._on_signal)
        return self

    def __exit__(self, *_: object) -> None:
        signal.signal(signal.SIGINT, self._former)

    def requested(self) -> bool:
        """Whether Ctrl-C was pressed."""
        return self._requested

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self._requested:
            signal.default_int_handler(number, frame)
        self._requested = True
        self._console.print("Ending after this step and writing everything; Ctrl-C again to quit at once.")


def print_metrics(console: Console, metrics: Metrics, folder: Path) -> None:
    """Print the metrics of a run and where its folder lies."""
    table = Table(box=None, show_header=False)
    for label, value, unit in (
        ("completion ratio (< 5 cm)", metrics.completion_ratio, "%"),
        ("completion ratio, observable", metrics.observable_ratio, "%"),
        ("completion (capped at 1 m)", metrics.completion_cm, "cm"),
        ("mesh accuracy", metrics.accuracy_cm, "cm"),
        ("mesh completion ratio (< 5 cm)", metrics.mesh_completion_ratio, "%"),
        ("mesh F-score, observed", metrics.observed_f_score, "%"),
        ("novel-view PSNR", metrics.novel_view_psnr_db, "dB"),
        ("novel-view SSIM", metrics.novel_view_ssim, ""),
        ("novel-view depth L1", metrics.novel_view_depth_l1_cm, "cm"),
        ("steps", metrics.steps, f"({metrics.turns} turns, {metrics.blocked} blocked)"),
        ("path length", metrics.path_m, "m"),
        ("rate", metrics.hz, "steps/s"),
        ("peak RSS", metrics.peak_rss_mib, "MiB"),
    ):
        if value is not None:
            table.add_row(label, f"{value:.2f}" if isinstance(value, float) else str(value), unit)
    table.add_row("stop reason", metrics.stop_reason or "killed", "")
    console.print(table)
    console.print(f"Run folder: {folder}", highlight=False, soft_wrap=True)
