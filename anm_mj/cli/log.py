"""Where the log of a command goes."""

from __future__ import annotations

import logging

from rich.console import Console
from rich.logging import RichHandler


def log_to(console: Console, *, verbose: bool = False) -> None:
    """Send what the project logs to a console, with ``verbose`` details too, and of other packages only warnings."""
    handler = RichHandler(console=console, show_time=False, show_level=False, show_path=False)
    logging.basicConfig(level=logging.WARNING, format="%(message)s", handlers=[handler], force=True)
    logging.getLogger("anm_mj").setLevel(logging.DEBUG if verbose else logging.INFO)
