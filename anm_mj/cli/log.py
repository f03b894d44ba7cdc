"""Where the log of a command goes."""

from __future__ import annotations

import logging

from rich.console import Console


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
    """Send what the project logs to a console, of other packages only warnings.

    Args:
        console: where to.
        verbose: details too.
        quiet: of the project only warnings, too.
    """
    logging.basicConfig(level=logging.WARNING, format="%(message)s", handlers=[_Lines(console)], force=True)
    logging.getLogger("anm_mj").setLevel(logging.DEBUG if verbose else logging.WARNING if quiet else logging.INFO)
