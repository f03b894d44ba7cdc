"""A run folder is written by one program at a time."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from anm_mj.errors import RunFolderError


@contextmanager
def held(path: Path) -> Iterator[None]:
    """Hold a folder against other programs, from before its state is read; the system lets go however this one ends.
    Raises RunFolderError if another program holds it, or it cannot be opened.
    """
    try:
        folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as err:
        raise RunFolderError(f"{path} cannot be opened ({err.strerror}); check its permissions.") from err
    try:
        if not lock(folder):
            raise RunFolderError(f"Another program is writing to {path}; wait until it has ended, or stop it first.")
        yield
    finally:
        # A process that was forked meanwhile would keep what is only closed.
        with suppress(OSError):
            fcntl.flock(folder, fcntl.LOCK_UN)
        os.close(folder)


def lock(descriptor: int) -> bool:
    """Lock an open file or folder until it is closed; False if another program has locked it."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    # A share of Windows refuses in its own way.
    except (BlockingIOError, PermissionError):
        return False
    except OSError:
        # Some network file systems know no locks.
        return True
    return True
