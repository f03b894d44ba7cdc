"""Errors of reading and writing files of runs and sequences, as one sentence that names the file."""

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from anm_mj.errors import RunFolderError


@contextmanager
def reading(path: Path, kind: str = "", remedy: str = "copy it again") -> Iterator[None]:
    """Turn errors of the system, and what readers say of a damaged file, into a :class:`RunFolderError` that names
    ``path``, the ``kind`` of content that it should have, and the ``remedy``.
    """
    try:
        yield
    except (OSError, ValueError) as err:
        raise RunFolderError(f"{path} cannot be read{kind and f' as {kind}'} ({err}); {remedy}.") from err


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn errors of the system, such as a full disk, into a :class:`RunFolderError` that names ``path``."""
    try:
        yield
    # torch reports a full disk as a RuntimeError.
    except (OSError, RuntimeError) as err:
        why = getattr(err, "strerror", None) or err
        full = not isinstance(err, OSError) or err.errno in (errno.ENOSPC, errno.EDQUOT)
        remedy = "free some space or choose another folder" if full else "choose another folder"
        raise RunFolderError(f"{path} cannot be written ({why}); {remedy}.") from err
