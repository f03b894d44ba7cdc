"""``curve.csv`` as numbers, whoever wrote it."""

import csv
from pathlib import Path

import numpy as np
from jaxtyping import Float

from anm_mj.io.write import reading
from anm_mj.utils.read_file import read_text

COMPLETION_COLUMNS = ("step", "completion_ratio", "completion_cm", "observable_ratio", "path_m")
COLUMNS = (*COMPLETION_COLUMNS, "position_error_cm", "heading_error_deg")
"""Of the file; others are left alone."""
GROWING = ("completion_ratio", "observable_ratio", "path_m")
"""Columns that never fall: what was seen stays seen."""
_ROUNDING = 1e-6
_LARGEST = 1e12
"""No value of a curve is larger."""


def read_curve(path: Path) -> dict[str, Float[np.ndarray, " n"]]:
    """The columns of ``curve.csv``; NaN where nothing is known, and no rows where there is no file.

    An incomplete last row, as a killed run leaves it, is skipped. Raises RunFolderError if the file cannot be read, or
    holds no curve.
    """
    if not path.is_file():
        return {name: np.zeros(0) for name in COLUMNS}
    with reading(path, "a curve", "evaluate the run again"):
        return _columns(read_text(path).splitlines())


def _columns(text: list[str]) -> dict[str, Float[np.ndarray, " n"]]:
    """Raises ValueError for what is no curve."""
    try:
        lines = list(csv.reader(text))
    except csv.Error as err:
        raise ValueError(str(err)) from err
    names, rows = (lines[0], lines[1:]) if lines else ([], [])
    if "step" not in names:
        raise ValueError("it has no column 'step'")
    if rows and len(rows[-1]) < len(names):
        rows.pop()
    if any(len(row) < len(names) for row in rows):
        raise ValueError(f"a row has fewer than {len(names)} cells")
    unknown = np.full(len(rows), np.nan)
    columns = {
        name: np.array([float(row[names.index(name)] or "nan") for row in rows]) if name in names else unknown
        for name in COLUMNS
    }
    steps = columns["step"]
    if not ((steps == np.floor(steps)).all() and (np.diff(steps, prepend=-1.0) > 0.0).all()):
        raise ValueError("its steps are not whole numbers that grow")
    for name, column in columns.items():
        most = 100.0 + _ROUNDING if name.endswith("_ratio") else _LARGEST
        if ((column < 0.0) | (column > most)).any():
            raise ValueError(f"{name} is {column[(column < 0.0) | (column > most)][0]:g}; it goes from 0 to {most:g}")
        known = column[np.isfinite(column)]
        if name in GROWING and (np.diff(known) < -_ROUNDING).any():
            raise ValueError(f"{name} falls from one row to the next")
    return columns
