"""The standard streams, whatever they are: closed, full, or read by nobody. Loads no rich, so that help is at once."""

import errno
import io
import os
import sys
from typing import IO

from anm_mj.errors import RunFolderError


def open_streams() -> None:
    """Let the program print whatever its output is: closed, or of an encoding that lacks some letters."""
    # A file that is opened gets the number of a closed stream, and with it what libraries print.
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(descriptor)
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def say_result(text: str) -> None:
    """Print a text that was asked for, also where nothing else is printed. Raises RunFolderError where the disk is
    full.
    """
    try:
        sys.stdout.write(f"{text}\n")
        sys.stdout.flush()
    except OSError as err:
        give_up(sys.stdout, err)


def say_error(line: str) -> None:
    """Print a line about what is wrong; where that cannot be written, nobody can be told."""
    try:
        sys.stderr.write(f"{line}\n")
        sys.stderr.flush()
    except OSError:
        silence(sys.stderr)


def give_up(stream: IO[str], err: OSError) -> None:
    """Write nothing more to a stream that cannot be written. Raises RunFolderError, whose sentence a run completes,
    unless nobody reads it any more.
    """
    silence(stream)
    # A terminal that was closed, of a program that goes on without it, is an error of input and output.
    if not isinstance(err, BrokenPipeError) and err.errno != errno.EIO:
        raise RunFolderError(
            f"What the program prints cannot be written ({err.strerror}); free some space, or print to another place."
        ) from err


def silence(stream: IO[str]) -> None:
    """Let what is written to a stream from now on go nowhere, with what Python flushes at its end."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)
