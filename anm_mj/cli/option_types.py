"""What options may hold, where Python's own types take too much."""

from __future__ import annotations

from argparse import ArgumentTypeError
from collections.abc import Sequence
from pathlib import Path


def place(text: str) -> Path:
    """A file or folder to write.

    Raises:
        ArgumentTypeError: it has no name, which would be the current folder.
    """
    if not text.strip():
        raise ArgumentTypeError("it is empty; name a file or folder, or leave the option out")
    return Path(text)


def port(text: str) -> int:
    """The number of a port.

    Raises:
        ArgumentTypeError: it is none.
    """
    if not (text.isdecimal() and len(text) <= 5 and 1 <= int(text) <= 65535):
        raise ArgumentTypeError(f"{text!r} is no port; give a number from 1 to 65535")
    return int(text)


def require_ending(out: Path | None, endings: Sequence[str]) -> None:
    """Accept the place of a picture by its ending.

    Raises:
        ConfigError: it ends in no kind that can be written.
    """
    if out is not None and out.suffix not in endings:
        from anm_mj.config import ConfigError

        raise ConfigError(f"--out is '{out}'; give a file that ends in {' or '.join(endings)}.")
