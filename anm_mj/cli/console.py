"""Consoles of the command line, on which no file of others commands the terminal; progress bars, and where logs go."""

import json
import logging
import os
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from typing import Any

from rich import progress as bars
from rich.console import Console
from rich.text import Text

from anm_mj.cli.command_line import Manner
from anm_mj.cli.streams import give_up, say_result, silence
from anm_mj.utils.progress import Progress

UNUSABLE = 1
"""Exit status of a check that found what it checked unusable."""
_WIDE = 10_000
"""Characters of a line where no terminal is: what a program reads is not broken into lines."""


class PlainConsole(Console):
    """A console that takes no markup from texts and prints characters that would command the terminal as escapes.

    What it prints is for people: it is silent where only JSON or nothing was asked for, unless it is that of errors.
    """

    manner = Manner()
    """How the command speaks."""

    def __init__(self, *, stderr: bool = False) -> None:
        silent = not stderr and (self.manner.quiet or self.manner.json)
        super().__init__(stderr=stderr, markup=False, emoji=False, quiet=silent)
        if not self.is_terminal and "COLUMNS" not in os.environ:
            self.width = _WIDE

    @property
    def is_terminal(self) -> bool:
        """Whether somebody sees what moves."""
        return not self.quiet and super().is_terminal

    def render_str(self, text: str, **options: Any) -> Text:
        """What is printed for a text, alone or in a cell of a table."""
        return super().render_str(printable(text), **options)

    def _check_buffer(self) -> None:
        """Write what was printed. Raises RunFolderError where the disk is full, unless that is where errors go."""
        try:
            super()._check_buffer()
        except OSError as err:
            self.quiet = True
            if self.stderr:
                silence(self.file)
            else:
                give_up(self.file, err)

    def on_broken_pipe(self) -> None:
        """Be silent from now on: whoever read the output has enough, and the command goes on to its end."""
        self.quiet = True
        silence(self.file)

    def say(self, *lines: str, style: str | None = None) -> None:
        """Print lines as long as they are, so that they can be copied and stored."""
        for line in lines:
            self.print(line, style=style, highlight=False, soft_wrap=True)


def say_json(facts: object) -> None:
    """Print a result for programs as JSON."""
    from anm_mj.io.to_json import to_json

    say_result(json.dumps(to_json(facts), indent=2))


def say_problems(problems: Sequence[str]) -> int:
    """Print why something that was checked cannot be used; the exit status, which is ``UNUSABLE`` then."""
    PlainConsole(stderr=True).say(*(f"anm-mj: {problem}" for problem in problems), style="red")
    return UNUSABLE if problems else 0


def printable(text: str) -> str:
    """A text in which no character commands the terminal: files of others may name anything anyhow."""
    return "".join(c if c.isprintable() or c == "\n" else repr(c)[1:-1] for c in text)


@contextmanager
def progress_bar(console: Console, words: str, *columns: bars.ProgressColumn) -> Iterator[Progress]:
    """Show a bar while the block runs, with the ``columns`` behind it, by default the share and the time left; nothing
    without a terminal. Yields a function to call with what is done and in all.
    """
    columns = columns or (bars.TaskProgressColumn(), bars.TimeRemainingColumn())
    shown = bars.TextColumn("{task.description}"), bars.BarColumn(), *columns
    with bars.Progress(*shown, console=console, disable=not console.is_terminal, transient=True) as progress:
        task = progress.add_task(words, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)


def busy(console: Console, words: str) -> AbstractContextManager[Progress]:
    """Show that something goes on, and for how long; nothing without a terminal. For what nobody knows the rest of."""
    return progress_bar(console, words, bars.TimeElapsedColumn())


class _Lines(logging.Handler):
    """Prints a record as one line however wide the console is: what is stored in a file or copied stays whole."""

    def __init__(self, console: Console) -> None:
        super().__init__()
        self._console = console

    def emit(self, record: logging.LogRecord) -> None:
        try:
            self._console.print(self.format(record), markup=False, highlight=False, soft_wrap=True)
        except Exception:
            self.handleError(record)


def log_to(console: Console, *, verbose: bool = False, quiet: bool = False) -> None:
    """Send what the project logs to a console, ``verbose`` with details; ``quiet`` only warnings, as of others."""
    logging.basicConfig(level=logging.WARNING, format="%(message)s", handlers=[_Lines(console)], force=True)
    logging.getLogger("anm_mj").setLevel(logging.DEBUG if verbose else logging.WARNING if quiet else logging.INFO)
