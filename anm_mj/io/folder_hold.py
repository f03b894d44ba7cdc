"""A run folder is written by one program at a time."""

from __future__ import annotations

import fcntl
import os
import weakref
from pathlib import Path

from anm_mj.errors import RunFolderError


class FolderHold:
    """Holds a folder against other programs until it is closed; the system lets go however this one ends."""

    def __init__(self, path: Path) -> None:
        """Raises RunFolderError if another program holds the folder, or it cannot be opened."""
        try:
            folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
        except OSError as err:
            raise RunFolderError(f"{path} cannot be opened ({err.strerror}); check its permissions.") from err
        self.close = weakref.finalize(self, os.close, folder)
        try:
            fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as err:
            self.close()
            raise RunFolderError(
                f"Another program is writing to {path}; wait until it has ended, or stop it first."
            ) from err
        except OSError:
            # Some network file systems know no locks.
            pass

    def __enter__(self) -> FolderHold:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
