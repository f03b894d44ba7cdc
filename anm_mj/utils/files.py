"""Files that are written whole or not at all, and the user's cache folder."""

import errno
import logging
import os
import tempfile
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

_logger = logging.getLogger(__name__)


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside ``path``; the file written there replaces ``path`` if the block succeeds.

    Other processes, and a killed run, never see half a file. Raises OSError if the folder cannot be written.
    """
    partial = beside(path)
    with removed_on_error(partial):
        yield partial
        partial.replace(path)


def beside(path: Path) -> Path:
    """A name in the same folder that nobody else uses, for what is to become ``path``."""
    return path.with_name(f".{path.name}.{uuid.uuid4().hex}")


def file_name(text: str) -> str:
    """A text of somebody else's as a part of a file's name, which leads into no other folder."""
    return "".join(c if c.isalnum() or c in "-._" else "-" for c in text)


@contextmanager
def removed_on_error(path: Path) -> Iterator[None]:
    """Remove a file if the block fails."""
    try:
        yield
    except BaseException:
        path.unlink(missing_ok=True)
        raise


def write_text(path: Path, text: str) -> None:
    """Write a text file whole or not at all, in UTF-8, line feeds as they are. Raises OSError if it fails."""
    with atomic_write(path) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")


def sync(path: Path) -> None:
    """Force a file, or the names in a folder, to the disk. Raises OSError if the system cannot."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_tensors(path: Path, arrays: dict[str, np.ndarray], said: dict[str, str]) -> None:
    """Write a safetensors file of arrays in C order, from the memory that they lie in, and the texts of its header.
    Raises OSError if it cannot be written.
    """
    from safetensors import SafetensorError
    from safetensors.numpy import save_file

    # The library replaces the file by one that only its owner may read.
    path.touch()
    mode = path.stat().st_mode
    try:
        save_file(arrays, path, said)
    except SafetensorError as err:
        raise OSError(errno.EIO, str(err)) from err
    path.chmod(mode)


def home_folder() -> Path:
    """The user's home; for a user who has none, as in a container, :func:`nowhere_folder`."""
    try:
        return Path.home()
    except RuntimeError:
        return nowhere_folder()


def nowhere_folder() -> Path:
    """A folder below the temporary ones for a user who has no home, or may not write there."""
    return Path(tempfile.gettempdir()) / f"anm_mj-{os.getuid()}"


def cache_folder(name: str = "") -> Path:
    """A folder in the user's cache (``XDG_CACHE_HOME`` or ``~/.cache``); its content may be deleted at any time."""
    return Path(os.environ.get("XDG_CACHE_HOME") or home_folder() / ".cache") / "anm_mj" / name


def store_in_cache(path: Path, content: bytes) -> None:
    """Write a file of the cache; an error is logged and has no other effect."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as partial:
            partial.write_bytes(content)
    except OSError as err:
        _logger.debug("%s was not cached: %s", path, err)
