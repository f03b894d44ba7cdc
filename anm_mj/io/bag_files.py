"""Which files a recording consists of: a folder with or without its metadata, or one file alone."""

import logging
import os
from pathlib import Path

from anm_mj.io.cut_mcap import CutMcap, is_cut, mended
from anm_mj.io.sequence_text import files_in_order
from anm_mj.utils.read_file import open_regular

_SUFFIXES = (".bag", ".mcap", ".db3")

_logger = logging.getLogger(__name__)


def is_recording(path: Path) -> bool:
    """Whether a path is a bag: a file of one, or a folder with a ``metadata.yaml``."""
    return path.suffix in _SUFFIXES or os.path.isfile(path / "metadata.yaml")


def files_in(folder: Path) -> list[Path]:
    """The files of a recording in a folder, in the order of their numbers: those of the first kind there is. Raises
    OSError if the folder cannot be read.
    """
    return next((files for suffix in _SUFFIXES if (files := files_in_order(folder, f"*{suffix}"))), [])


def readable_parts(path: Path) -> list[Path | CutMcap]:
    """What the package rosbags is to open: the folder where its metadata are whole, else each file.

    Warnings tell of missing metadata and of files that end in the middle. Raises OSError or ValueError if a file cannot
    be read, is no regular file, or is damaged before its end.
    """
    # The package would wait for a FIFO.
    for file in sorted(path.iterdir()) if path.is_dir() else (path,):
        if not file.is_dir():
            open_regular(file).close()
    files = files_in(path) if path.is_dir() else [path]
    cut = [file for file in files if file.suffix == ".mcap" and is_cut(file)]
    metadata = path / "metadata.yaml"
    if path.is_dir() and not cut and (not files or (metadata.is_file() and metadata.stat().st_size)):
        return [path]
    if path.is_dir() and not metadata.is_file():
        _logger.warning("%s has no metadata.yaml: its %d files are read without it.", path, len(files))
    parts: list[Path | CutMcap] = []
    for file in files:
        if file not in cut:
            parts.append(file)
            continue
        part = mended(file)
        _logger.warning("%s ends in the middle: the %d messages up to there are read.", file, part.messages)
        if part.messages:
            parts.append(part)
    if not parts:
        raise ValueError("it is cut, and no message of it is whole")
    return parts
