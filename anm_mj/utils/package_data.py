"""Where the builtin robots and scenes lie: beside the package in a checkout, inside of it once it is installed."""

from functools import cache
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]
INSTALLED = "data"
"""Folder of the package that a wheel holds them in (``wheel.packages`` in pyproject.toml)."""


@cache
def data_folder(name: str) -> Path:
    """The folder ``models`` or ``scenes``, as files on the disk: MuJoCo opens them by their paths.

    An editable installation runs the checkout's package and reads the checkout's folders.
    """
    installed = _PACKAGE / INSTALLED / name
    return installed if installed.is_dir() else _PACKAGE.parent / name


def checkout() -> Path | None:
    """The checkout that the package runs from; None where it was installed from a wheel."""
    return None if (_PACKAGE / INSTALLED).is_dir() else _PACKAGE.parent
