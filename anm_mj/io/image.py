"""Reads images of run folders and recorded sequences."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from anm_mj.errors import RunFolderError
from anm_mj.utils.picture import open_picture


def read_image(path: Path, mode: str | None = None) -> np.ndarray:
    """Read an image as an array (rows, columns[, channels]).

    Args:
        path: Image file.
        mode: PIL mode to convert to, such as ``RGB``; None keeps that of the file.

    Raises:
        RunFolderError: The image is missing or damaged.
    """
    try:
        with open_picture(path) as image:
            return np.asarray(image.convert(mode) if mode else image)
    # A decoder raises SyntaxError for a damaged PNG.
    except (OSError, SyntaxError, ValueError) as err:
        raise RunFolderError(f"{path} cannot be read ({err}); copy it again.") from err
