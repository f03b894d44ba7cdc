"""Runs the function of a script with the words of the command line."""

import sys
from collections.abc import Callable

from anm_mj.errors import AnmError

FAILED = 2


def run_script(main: Callable[..., None]) -> None:
    """Run it; an error of this program is one sentence and exit status 2."""
    import tyro

    try:
        tyro.cli(main)
    except AnmError as err:
        sys.stderr.write(f"{err}\n")
        sys.exit(FAILED)
