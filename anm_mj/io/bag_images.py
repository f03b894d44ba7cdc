"""Images out of the messages of a recording: ``sensor_msgs`` Image and CompressedImage, and compressed depth."""

import io
import struct
from typing import Any

import numpy as np
from jaxtyping import Float32, UInt8

from anm_mj.io.camera_checks import FARTHEST_M
from anm_mj.io.image import is_sentinel, require_depth
from anm_mj.utils.picture import read_picture

_DEPTH_TYPES = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
COLOUR_CHANNELS = {
    "rgb8": (0, 1, 2), "bgr8": (2, 1, 0), "rgba8": (0, 1, 2), "bgra8": (2, 1, 0), "8UC3": (2, 1, 0),
    "mono8": (0, 0, 0), "8UC1": (0, 0, 0),
}  # fmt: skip
"""Which channel of a pixel is red, green and blue; 8UC3 is BGR, as OpenCV writes it."""
NUM_CHANNELS = {"rgba8": 4, "bgra8": 4, "mono8": 1, "8UC1": 1}
_MOST_PADDING = 64
"""Rows end in fewer bytes than this, or than their pixels, that mean nothing."""
_PNG, _PNG_TYPE = b"\x89PNG\r\n\x1a\n", slice(24, 26)
"""How a PNG begins, and where it says its bits and its kind of pixels."""
DEPTH_HEADER = struct.Struct("<iff")
"""What compressed_depth_image_transport puts before its PNG: format and two parameters of the quantisation."""


def encoding_of(message: Any) -> str:
    """``depth``, ``colour``, or the encoding that is neither."""
    encoding = getattr(message, "encoding", None)
    if encoding is None:
        # A 16-bit image is packed into a PNG without the header of compressedDepth, too.
        encoding = message.format.partition(";")[0].strip()
        is_depth = "compressedDepth" in message.format or encoding in _DEPTH_TYPES or _is_deep_png(message)
        return "depth" if is_depth else "colour"
    if encoding in _DEPTH_TYPES:
        return "depth"
    return "colour" if encoding in COLOUR_CHANNELS else encoding


def colour_image(message: Any) -> UInt8[np.ndarray, "h w 3"]:
    """The colours of a message. Raises ValueError if the data do not fit the message's size, or are no picture, and
    OSError for the same, of compressed data.
    """
    if not hasattr(message, "encoding"):
        with read_picture(io.BytesIO(_bytes(message))) as picture:
            return np.asarray(picture.convert("RGB"))
    if message.encoding not in COLOUR_CHANNELS:
        raise ValueError(f"{_encoding(message)} is no colour")
    pixels = _rows(message, "u1", NUM_CHANNELS.get(message.encoding, 3))
    return np.ascontiguousarray(pixels[..., COLOUR_CHANNELS[message.encoding]])


def depth_image(message: Any, unit_m: float, *, far: bool = False) -> Float32[np.ndarray, "h w"]:
    """Planar depth of a message [m]; NaN where nothing was measured, or what no camera sees. ``message`` is an Image of
    encoding 16UC1, mono16 or 32FC1 (metres), or compressed depth; ``unit_m`` are metres per unit of 16-bit values;
    ``far`` keeps the +inf that REP 118 gives to what lies beyond the range. Raises ValueError if the data do not fit
    the message's size, or are no picture, and OSError for the same, of compressed data.
    """
    if not hasattr(message, "encoding"):
        depth_m = _compressed_depth(message, unit_m)
    elif message.encoding not in _DEPTH_TYPES:
        raise ValueError(f"{_encoding(message)} is no depth")
    else:
        raw = _rows(message, _DEPTH_TYPES[message.encoding], 1)[..., 0]
        # Any bits may stand for a float, also those that warn.
        with np.errstate(invalid="ignore"):
            depth_m = raw.astype(np.float32) * np.float32(1.0 if message.encoding == "32FC1" else unit_m)
        if message.encoding != "32FC1":
            depth_m[is_sentinel(raw)] = np.nan
    kept = (depth_m > 0.0) & (depth_m <= FARTHEST_M)
    return np.where(kept | (far & np.isposinf(depth_m)), depth_m, np.float32(np.nan))


def states_metres(message: Any) -> bool:
    """Whether a depth image is floating point, which is in metres."""
    return getattr(message, "encoding", None) == "32FC1" or getattr(message, "format", "").startswith("32FC1")


def _is_deep_png(message: Any) -> bool:
    """Whether compressed data are a PNG of one channel of 16 bits, whatever their format says, as ``png`` alone."""
    start = bytes(np.asarray(message.data[: _PNG_TYPE.stop], np.uint8))
    return start.startswith(_PNG) and start[_PNG_TYPE] == b"\x10\x00"


def _compressed_depth(message: Any, unit_m: float) -> Float32[np.ndarray, "h w"]:
    data, a, b = _bytes(message), 0.0, 0.0
    if "compressedDepth" in message.format:
        if len(data) <= DEPTH_HEADER.size:
            raise ValueError("compressed depth is empty")
        _, a, b = DEPTH_HEADER.unpack_from(data)
        data = data[DEPTH_HEADER.size :]
    with read_picture(io.BytesIO(data)) as picture:
        require_depth(picture)
        stated = np.asarray(picture)
    raw = stated.astype(np.float32)
    if not message.format.startswith("32FC1"):
        empty = is_sentinel(stated) if stated.dtype.kind in "iu" else False
        return np.where(empty, np.float32(np.nan), raw * np.float32(unit_m))
    # Inverse depth, see compressed_depth_image_transport/codec.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.where(raw > 0.0, np.float32(a) / (raw - np.float32(b)), np.float32(0.0)).astype(np.float32)


def _rows(message: Any, kind: str, channels: int) -> np.ndarray:
    """The pixels of an image, without the padding at the ends of its rows."""
    dtype = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    wide = int(message.width) * channels * dtype.itemsize
    data, step = _bytes(message), int(message.step)
    if message.width < 1 or message.height < 1:
        raise ValueError(f"it has {message.width} x {message.height} pixels")
    if step < wide or len(data) < step * int(message.height):
        raise ValueError(f"{len(data)} bytes are not {message.height} rows of {step}, of which {wide} are pixels")
    if step - wide >= max(wide, _MOST_PADDING):
        raise ValueError(
            f"its rows have {step} bytes, but {message.width} pixels of {_encoding(message)} have {wide}: the encoding "
            "is another one"
        )
    rows = np.frombuffer(data, np.uint8, step * int(message.height)).reshape(int(message.height), step)[:, :wide]
    return np.ascontiguousarray(rows).view(dtype).reshape(int(message.height), int(message.width), channels)


def _encoding(message: Any) -> str:
    return repr(message.encoding[:40])


def _bytes(message: Any) -> bytes:
    return bytes(np.asarray(message.data, np.uint8))
