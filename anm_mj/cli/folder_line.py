"""The last lines of a command that leaves a run."""

from __future__ import annotations

import shlex
from pathlib import Path

from rich.console import Console


def print_folder(console: Console, folder: Path) -> None:
    """Print where a run lies, and how to look at it."""
    console.print(f"Run folder: {folder}", highlight=False, soft_wrap=True)
    console.print(f"Replay: anm-mj view {shlex.quote(str(folder))}", highlight=False, soft_wrap=True)
