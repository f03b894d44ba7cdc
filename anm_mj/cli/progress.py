"""A run in the terminal: one live line while it goes on, and a well-ordered end at Ctrl-C."""

from __future__ import annotations

import math
import os
import signal
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from types import FrameType

from rich.live import Live
from rich.text import Text

from anm_mj.cli.console import PlainConsole
from anm_mj.events import Decided, Ended, Observed, Observer, Stepped
from anm_mj.io.run_events import Started, Surveying, headline
from anm_mj.types import Plan
from anm_mj.utils.progress import Progress

PLAIN_EVERY = 50
"""Steps between two printed lines, if the output is no terminal."""


class ProgressLine:
    """One live line: step, completion ratio, rate, time left; with ``details`` also target, loss and reason. Without a
    terminal, plain lines.
    """

    def __init__(self, console: PlainConsole, *, details: bool = False):
        self._console = console
        self._details = details
        self._loss = math.nan
        self._started: Started | None = None
        self._begun: tuple[int, float] | None = None
        """Step and time [s] of the first report."""
        self._live = Live(console=console, refresh_per_second=4, transient=True) if console.is_terminal else None
        self._ended: Ended | None = None

    def __enter__(self) -> ProgressLine:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._live is not None:
            self._live.stop()
        elif kind is None and self._ended is not None:
            # The last figures were computed while the map was finished.
            self._console.say(_line(self._so_far(self._ended.num_steps, self._ended.loop_s)))

    def on_event(self, event: object) -> None:
        """Show an event of the run; see :class:`anm_mj.events.Observer`."""
        if isinstance(event, Surveying):
            self.survey(event.done, event.total)
        elif isinstance(event, Started):
            self._started = event
        elif isinstance(event, Stepped):
            self._step(event)
        elif isinstance(event, Ended):
            self._ended = event
            if self._live is not None:
                self._live.update(
                    Text(f"step {event.num_steps}, the last · finishing the map, its mesh and the metrics")
                )

    def survey(self, done: int, total: int) -> None:
        """Show how far the search for the observable surface is."""
        if self._live is not None:
            self._live.update(Text(f"computing the observable surface (once per scene): {100 * done // total} %"))
        elif done == 1:
            self._console.print("Computing the observable surface (once per scene).")

    def _step(self, report: Stepped) -> None:
        assert self._started is not None, "the start comes first"
        num_steps = self._started.num_steps
        if report.update.num_iterations:  # Not every step trains.
            self._loss = report.update.loss
        self._begun = self._begun or (report.step, time.monotonic())
        # The last step's line is printed at the end, with its completion.
        if self._live is None and (report.step % PLAIN_EVERY or report.step == num_steps):
            return
        parts = [*self._so_far(report.step, report.loop_s), self._left(report.step, num_steps)]
        if self._details:
            target = report.plan.target_xy_m
            parts += [
                f"target {target[0]:.1f},{target[1]:.1f}" if target is not None else "",
                f"loss {self._loss:.3g}",
                report.plan.reason,
            ]
        if self._live is None:
            self._console.say(_line(parts))
        else:
            self._live.update(Text(_line(parts), no_wrap=True, overflow="ellipsis"))

    def _so_far(self, step: int, loop_s: float) -> list[str]:
        """Step, completion with the step that it is of, and rate."""
        assert self._started is not None, "the start comes first"
        row = self._started.completed()
        completed = "" if row is None else "{:.1f} % of {}".format(*headline(row))
        if row is not None and row.step < step:
            completed += f" at step {row.step}"
        return [f"step {step} of {self._started.num_steps}", completed, f"{step / max(loop_s, 1e-9):.1f} steps/s"]

    def _left(self, step: int, num_steps: int) -> str:
        """Time left, at the rate since the first report, evaluation included; empty where nothing is known or left."""
        assert self._begun is not None
        first, begun_s = self._begun
        if step <= first or step >= num_steps:
            return ""
        left_s = round((time.monotonic() - begun_s) / (step - first) * (num_steps - step))
        minutes, seconds = divmod(left_s, 60)
        hours_minutes = f"{minutes // 60}:{minutes % 60:02d}" if minutes >= 60 else str(minutes)
        return f"{hours_minutes}:{seconds:02d} left"


class FrameLine:
    """How far a recorded sequence is mapped: ``on_progress`` is told it; without a terminal also what the policy would
    do, now and then.
    """

    def __init__(self, console: PlainConsole, on_progress: Progress):
        self._console, self._on_progress = console, on_progress
        self._total = 0
        self._plan: Plan | None = None

    def on_event(self, event: object) -> None:
        """Show an event of the mapping; see :class:`anm_mj.events.Observer`."""
        if isinstance(event, Started):
            self._total = event.num_steps
        elif isinstance(event, Decided):
            self._plan = event.plan
        elif isinstance(event, Observed):
            done = event.observation.step + 1
            self._on_progress(done, self._total)
            if not self._console.is_terminal and (done % PLAIN_EVERY == 0 or done == self._total):
                self._console.say(f"frame {done}/{self._total}{_intent(self._plan)}")


def _line(parts: Iterable[str]) -> str:
    """What is known, in one line."""
    return " · ".join(filter(None, parts))


def _intent(plan: Plan | None) -> str:
    """What the policy would have done."""
    if plan is None:
        return ""
    target = "would stay" if plan.target_xy_m is None else "would go to ({:.2f}, {:.2f})".format(*plan.target_xy_m)
    return f": {target}: {plan.reason}"


_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C, the end that a cluster or a system announces, and a terminal that was closed."""


class Interrupt:
    """The first signal ends the run after its present step, and prints what is ``said``; a second one, but for SIGHUP,
    ends the program.

    What is ignored stays ignored, such as SIGHUP below ``nohup``.
    """

    is_requested = False
    """Whether the end of the run was asked for."""

    def __init__(
        self,
        console: PlainConsole,
        said: str = "Ending after this step and writing everything; Ctrl-C again to quit at once.",
    ):
        self._console, self._said = console, said

    def __enter__(self) -> Interrupt:
        heard = [number for number in _SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
        self._previous = {number: signal.signal(number, self._on_signal) for number in heard}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def on_event(self, event: object) -> bool:
        """Whether the end of the run was asked for; see :class:`anm_mj.events.Observer`."""
        return self.is_requested

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        # The end of a session sends SIGTERM, and SIGHUP right behind it.
        if self.is_requested and number != signal.SIGHUP:
            signal.default_int_handler(number, frame)
        self.is_requested = True
        if number == signal.SIGHUP:
            # The terminal is gone: what is written to it from now on would end the program before the files.
            nowhere = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
            self._console.file = sys.stdout = sys.stderr = nowhere
        self._console.print(self._said)


@contextmanager
def live_view(title: str | None, port: int | None, interrupt: Interrupt) -> Iterator[list[Observer]]:
    """Show a page of this title while the block runs, None = none. ``port`` is the first to try, None = the usual one;
    ``interrupt`` knows whether the user has asked for the end elsewhere. Yields the page as an observer, if there is
    one.
    """
    if title is None:
        yield []
        return
    from anm_mj.viz.live_view import LiveView

    with closing(LiveView(port=port, title=title, is_ending=lambda: interrupt.is_requested)) as viewer:
        yield [viewer]
