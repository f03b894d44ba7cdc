"""Modules of the user's own: policies and mappers that no package has."""

import sys
from collections.abc import Iterable


def let_import_from(folders: Iterable[str]) -> None:
    """Let the modules of some folders be imported. They come last, so that a file there that is named like a module of
    Python's does not take its place.
    """
    sys.path += [folder for folder in folders if folder not in sys.path]
