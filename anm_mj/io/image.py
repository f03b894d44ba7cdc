"""Reads images of run folders and recorded sequences."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from anm_mj.errors import RunFolderError
from anm_mj.utils.picture import open_picture

DEPTH_MODES = ("I", "F", "I;16", "I;16B", "I;16L", "I;16N")
"""What PIL calls images of one channel with more than 8 bits."""


def read_image(path: Path, mode: str | None = None) -> np.ndarray:
    """Read an image as an array (rows, columns[, channels]).

    Args:
        path: Image file.
        mode: PIL mode to convert to, such as ``RGB``; None = that of a depth image.

    Raises:
        RunFolderError: The image is missing or damaged, or no depth image.
    """
    try:
        with open_picture(path) as image:
            if mode is None:
                require_depth(image)
            return np.asarray(image.convert(mode) if mode else image)
    # A decoder raises SyntaxError for a damaged PNG.
    except (OSError, SyntaxError, ValueError) as err:
        raise RunFolderError(f"{path} cannot be read ({err}); copy it again.") from err


def is_sentinel(stated: np.ndarray) -> np.ndarray:
    """Where whole numbers are the largest of 16 bits, or of their type: those say that nothing was measured."""
    # Pillow gives some images of 16 bits as 32.
    return (stated == 65535) | (stated == np.iinfo(stated.dtype).max)


def require_depth(image: Image.Image) -> None:
    """Raises ValueError for a picture of colours, of a palette, or of 8 bits, in which no depth has room."""
    if image.mode not in DEPTH_MODES:
        raise ValueError(f"it is no depth image: its pixels are {image.mode}, not one number of 16 bits each")
