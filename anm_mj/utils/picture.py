"""Opens pictures of anybody, without external programs or more pixels than memory bears; packs those of pages."""

import base64
import io
import math
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8
from PIL import EpsImagePlugin, Image, UnidentifiedImageError

from anm_mj.utils.read_file import open_regular

FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "TGA", "TIFF", "GIF", "PPM", "DDS")
"""Formats that are decoded; others may start programs, as EPS does."""
MAX_MEGAPIXELS = 100.0

_OF_DECODERS = (SyntaxError, struct.error, zlib.error, EOFError, IndexError, OverflowError)
"""What decoders raise for damaged pixels, beside OSError and ValueError."""

# Pillow is also called by libraries that read meshes; these limits hold there, too. Between one and two times the
# limit Pillow only warns.
Image.MAX_IMAGE_PIXELS = int(MAX_MEGAPIXELS * 1e6 / 2)
EpsImagePlugin.gs_binary = False


@contextmanager
def open_picture(path: Path) -> Iterator[Image.Image]:
    """Open a picture file; it is decoded when its pixels are asked for. Raises OSError if the file cannot be read, is
    no picture, or of another format than ``FORMATS``, and ValueError if it has more than ``MAX_MEGAPIXELS``, or its
    pixels cannot be decoded.
    """
    with open_regular(path) as file, read_picture(file) as image:
        yield image


@contextmanager
def read_picture(file: Any) -> Iterator[Image.Image]:
    """The same of a binary file that is open, or of bytes in memory."""
    try:
        image = Image.open(file, formats=FORMATS)
    except UnidentifiedImageError as err:
        # Its own words name an object of Python.
        raise OSError("it is no image, or of a format that is not read") from err
    except (Image.DecompressionBombError, SyntaxError) as err:
        raise ValueError(str(err)) from err
    with image:
        megapixels = math.prod(image.size) / 1e6
        if megapixels > MAX_MEGAPIXELS:
            raise ValueError(f"its {megapixels:.0f} megapixels are more than the {MAX_MEGAPIXELS:g} that are read")
        try:
            yield image
        except _OF_DECODERS as err:
            raise ValueError(f"its pixels cannot be decoded ({err})") from err


def jpeg_url(rgb: UInt8[np.ndarray, "h w 3"], side_px: int, quality: int) -> str:
    """A picture within a page, as JPEG of at most so many rows and columns."""
    image = Image.fromarray(rgb)
    image.thumbnail((side_px, side_px), Image.Resampling.BOX)
    buffer = io.BytesIO()
    image.save(buffer, "JPEG", quality=quality)
    return "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode()
