"""Reads the lists and tables beside the images of a sequence, as programs and editors write them."""

import fnmatch
import logging
import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from operator import itemgetter
from pathlib import Path

import numpy as np
from jaxtyping import Float

from anm_mj.io.camera_checks import LATEST_S
from anm_mj.utils.read_file import read_text

_USUAL_STEP_S = 0.05
"""From one frame or pose to the next, within a factor of 30 [s]."""
_NUMBER = re.compile(r"(\d+)")

_logger = logging.getLogger(__name__)


def rows(path: Path) -> Iterator[str]:
    """Lines of a text file that say something: neither empty nor a comment, without a byte order mark. Raises OSError
    or ValueError if the file cannot be read.
    """
    for line in read_text(path).removeprefix("\ufeff").splitlines():
        if (said := line.strip()) and not said.startswith("#"):
            yield said


def number_rows(path: Path, *columns: int) -> Float[np.ndarray, "n columns"]:
    """The rows of a table of numbers between blanks or commas; a first line of words is its header, and a comment may
    stand behind the numbers. Raises OSError or ValueError if the file cannot be read, holds something else, its rows
    differ in length, or it has another number of ``columns`` than one of these.
    """
    lines = [line.partition("#")[0].replace(",", " ").replace(";", " ").split() for line in rows(path)]
    if lines and not any(_is_number(word) for word in lines[0]):
        del lines[0]
    if len({len(line) for line in lines}) > 1:
        raise ValueError(f"the lines of {path.name} hold different counts of numbers")
    table = np.array([[float(word) for word in line] for line in lines]).reshape(len(lines), -1 if lines else 0)
    if columns and table.shape[1] not in columns:
        wanted = " or ".join(map(str, columns))
        raise ValueError(f"the lines of {path.name} hold {table.shape[1]} numbers, not {wanted}")
    return table


def seconds(times: Sequence[float]) -> list[float]:
    """Times that are later than any in seconds, as of nanoseconds, in the unit in which they pass as frames do: of
    those units in which they are no later than any in seconds.
    """
    stated = np.array(times, np.float64)
    if not len(stated) or not stated.max() > LATEST_S:
        return list(times)
    apart = np.diff(np.unique(stated))
    step = float(np.median(apart)) if len(apart) else float(stated.max()) / LATEST_S
    units = [unit for unit in (1e-3, 1e-6, 1e-9) if stated.max() * unit <= LATEST_S] or [1e-9]
    unit = min(units, key=lambda unit: abs(math.log(step * unit / _USUAL_STEP_S)))
    return (stated * unit).tolist()


def pose_rows(path: Path) -> list[Float[np.ndarray, "8"]]:
    """Times [s], positions [m] and quaternions of a file of TUM, by time. Lines of nan, or with a quaternion of zeros,
    are left out, with a warning. Raises OSError or ValueError if the file cannot be read, or holds something else.
    """
    lines = number_rows(path, 8, 0)
    if not len(lines):
        return []
    good = np.isfinite(lines).all(axis=1) & lines[:, 4:].any(axis=1)
    if not good.all():
        _logger.warning(
            "%s: %d of %d lines are no poses (the first at %.9g s) and are left out.",
            path,
            np.count_nonzero(~good),
            len(lines),
            lines[np.argmin(good), 0],
        )
    lines = lines[good]
    lines[:, 0] = seconds(lines[:, 0].tolist())
    return sorted(lines, key=itemgetter(0))


def in_number_order(name: str) -> list[str | int]:
    """Key that sorts ``frame2`` before ``frame10``."""
    return [int(part) if part.isdigit() else part for part in _NUMBER.split(name)]


def files_in_order(folder: Path, pattern: str) -> list[Path]:
    """The files of a folder that a pattern names, in the order of their numbers, without hidden ones: macOS puts a file
    ``._NAME`` beside each that it copies to a disk of another system. Raises OSError if there is no such folder.
    """
    names = fnmatch.filter(os.listdir(folder), pattern)
    files = (folder / name for name in sorted(names) if not name.startswith("."))
    return sorted(files, key=lambda path: in_number_order(path.stem))


def numbers_in(path: Path) -> list[int]:
    """The whole numbers in the name of a file, in their order."""
    return [part for part in in_number_order(path.stem) if isinstance(part, int)]


def paired_by_number(
    colours: Mapping[int, Path], depths: Mapping[int, Path], num_poses: int
) -> list[tuple[int, Path, Path]]:
    """Which of so many poses, and the images, of each number that a colour and a depth image have. Where numbers are
    missing, the count of poses says whether they have one.
    """
    numbers = sorted(colours.keys() | depths.keys())
    has_all = bool(numbers) and numbers[-1] - numbers[0] + 1 == num_poses
    return [
        (number - numbers[0] if has_all else rank, colours[number], depths[number])
        for rank, number in enumerate(numbers)
        if number in colours and number in depths
    ]


def with_slashes(name: str) -> str:
    """A name of a file whose folders may be separated as Windows does."""
    return name.replace("\\", "/")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
