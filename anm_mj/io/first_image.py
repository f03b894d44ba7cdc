"""The size of a sequence's images, by the first of them that can be read."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from anm_mj.errors import RunFolderError
from anm_mj.io.image import read_image
from anm_mj.io.sequence import Frame, require_below
from anm_mj.utils.read_file import read_npy


def first_shape(folder: Path, images: Iterable[object], mode: str | None = None) -> tuple[int, int]:
    """Rows and columns of the first of a sequence's images that can be read; ``mode`` as of :func:`.image.read_image`.
    What is no file is passed over. Raises RunFolderError if none can be read, with what is wrong with the first one,
    or if one lies outside of the sequence's ``folder``.
    """
    failures = []
    for path in (image for image in images if isinstance(image, Path)):
        require_below(folder, [Frame(0.0, path, path, np.eye(4))])
        try:
            rows, cols = _pixels(path, mode).shape[:2]
            return rows, cols
        except RunFolderError as err:
            failures.append(err)
    raise failures[0] if failures else RunFolderError(f"{folder} holds no image; copy it again.")


def _pixels(path: Path, mode: str | None) -> np.ndarray:
    """An image, also one that is an array; raises RunFolderError."""
    if path.suffix != ".npy":
        return read_image(path, mode)
    try:
        return read_npy(path)
    except (OSError, ValueError) as err:
        raise RunFolderError(f"{path} cannot be read ({err}).") from err
