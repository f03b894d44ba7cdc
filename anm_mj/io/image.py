"""Reads images of run folders and recorded sequences."""

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from PIL import Image, ImageOps

from anm_mj.errors import RunFolderError
from anm_mj.io.write import reading
from anm_mj.utils.picture import MAX_MEGAPIXELS, open_picture
from anm_mj.utils.read_file import is_below, open_regular, read_npy

DEPTH_MODES = ("I", "F", "I;16", "I;16B", "I;16L", "I;16N")
"""What PIL calls images of one channel with more than 8 bits."""


def read_image(path: Path, mode: str | None = None, *, turned: bool = False) -> np.ndarray:
    """Read an image as an array (rows, columns[, channels]). ``mode`` is PIL's to convert to, such as ``RGB``, None =
    that of a depth image; ``turned``: as its EXIF orientation says. Raises RunFolderError if the image is missing or
    damaged, or no depth image.
    """
    with reading(path), open_picture(path) as image:
        if mode is None:
            require_depth(image)
        upright = ImageOps.exif_transpose(image) if turned else image
        return np.asarray(upright.convert(mode) if mode else upright)


def read_pixels(path: Path, mode: str | None = None) -> np.ndarray:
    """The same of any file of a sequence's image: also of an array of NumPy, and of the first channel of OpenEXR."""
    if path.suffix == ".exr":
        return _read_exr(path)
    if path.suffix != ".npy":
        return read_image(path, mode)
    with reading(path):
        array = read_npy(path)
        if array.dtype.kind not in "fiu":
            raise ValueError(f"it holds {array.dtype}, which is no depth")
        return array


def first_shape(folder: Path, images: Iterable[object], mode: str | None = None) -> tuple[int, int]:
    """Rows and columns of the first of a sequence's images that can be read; ``mode`` as of :func:`read_image`. What is
    no file is passed over. Raises RunFolderError if none can be read, with what is wrong with the first one, or if one
    lies outside of the sequence's ``folder``.
    """
    failures = []
    for path in (image for image in images if isinstance(image, Path)):
        require_below(folder, [path])
        try:
            rows, cols = read_pixels(path, mode).shape[:2]
            return rows, cols
        except RunFolderError as err:
            failures.append(err)
    raise failures[0] if failures else RunFolderError(f"{folder} holds no image; copy it again.")


def require_below(folder: Path, images: Iterable[object]) -> None:
    """Raises RunFolderError where one of a sequence's images is a file outside of its folder."""
    for file in images:
        if isinstance(file, Path) and not is_below(file, folder):
            raise RunFolderError(f"{folder} names {file}, which lies outside of it; copy the image there.")


def _read_exr(path: Path) -> np.ndarray:
    """The first channel of an OpenEXR image: depth in metres. Raises RunFolderError if the package OpenEXR is missing,
    or the image is damaged.
    """
    try:
        import OpenEXR  # pyright: ignore[reportMissingImports] - optional
    except ImportError as err:
        raise RunFolderError(f"{path} needs the package OpenEXR: pip install 'anm-mj[exr]'.") from err
    try:
        open_regular(path).close()
        low, high = OpenEXR.File(str(path), header_only=True).header()["dataWindow"]
        if math.prod(int(pixels) for pixels in np.abs(high - low)) > MAX_MEGAPIXELS * 1e6:
            raise ValueError(f"it has more than {MAX_MEGAPIXELS:g} megapixels")
        channels = OpenEXR.File(str(path), separate_channels=True).channels()
        return next(iter(channels.values())).pixels
    except (OSError, ValueError, RuntimeError, KeyError, StopIteration) as err:
        raise RunFolderError(f"{path} cannot be read ({err}); copy it again.") from err


def is_sentinel(stated: np.ndarray) -> np.ndarray:
    """Where whole numbers are the largest of 16 bits, or of their type: those say that nothing was measured."""
    # Pillow gives some images of 16 bits as 32.
    return (stated == 65535) | (stated == np.iinfo(stated.dtype).max)


def require_depth(image: Image.Image) -> None:
    """Raises ValueError for a picture of colours, of a palette, or of 8 bits, in which no depth has room."""
    if image.mode not in DEPTH_MODES:
        raise ValueError(f"it is no depth image: its pixels are {image.mode}, not one number of 16 bits each")
