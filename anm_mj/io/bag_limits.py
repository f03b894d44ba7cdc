"""Limits on what the compressed parts of a bag unpack to.

The package rosbags unpacks chunks, messages and files whole, whatever comes out: some kilobytes may become terabytes.
"""

from __future__ import annotations

import bz2
import functools
from collections.abc import Callable
from typing import IO, Any

MAX_PART_BYTES = 256 << 20
"""A chunk or a message may unpack to this; recorders write chunks of a megabyte [bytes]."""
MAX_RATIO = 100
"""A compressed file may unpack to this many times its size, and to ``MAX_PART_BYTES`` in any case."""


@functools.cache
def limit_rosbags() -> None:
    """Put limits on all that rosbags unpacks in this process."""
    import lz4.frame
    from rosbags.rosbag1 import reader as rosbag1
    from rosbags.rosbag2 import reader as rosbag2
    from rosbags.rosbag2 import storage_mcap

    zstd: Any = vars(rosbag2)["zstd"]

    unpack_zstd = functools.partial(_unpacked, zstd.ZstdDecompressor)
    unpack_lz4 = functools.partial(_unpacked, lz4.frame.LZ4FrameDecompressor)
    rosbag1.decompressors["lz4"] = unpack_lz4
    rosbag1.decompressors["bz2"] = functools.partial(_unpacked, bz2.BZ2Decompressor)
    storage_mcap.DECOMPRESSORS["lz4"] = lambda data, _: unpack_lz4(data)
    storage_mcap.DECOMPRESSORS["zstd"] = lambda data, _: unpack_zstd(data)

    class LimitedZstd:
        """What the reader of ROS 2 bags uses of zstd."""

        decompress = staticmethod(unpack_zstd)
        ZstdDecompressor = zstd.ZstdDecompressor
        ZstdError = zstd.ZstdError

        @staticmethod
        def open(file: IO[bytes], mode: str) -> Any:
            return _LimitedFile(zstd.open(file, mode), _size_of(file))

    rosbag2.__dict__["zstd"] = LimitedZstd


def unpacked_start(compression: str, data: bytes) -> bytes:
    """As much of a chunk of an MCAP file as its bytes give, be it cut or not. Raises ValueError if the compression is
    unknown, the bytes are damaged, or unpack to more than is allowed.
    """
    import lz4.frame
    from rosbags.rosbag2 import reader as rosbag2

    if not compression:
        return data
    zstd: Any = vars(rosbag2)["zstd"]
    decompressors = {"zstd": zstd.ZstdDecompressor, "lz4": lz4.frame.LZ4FrameDecompressor}
    if compression not in decompressors:
        raise ValueError(f"the compression {compression[:20]!r} of its chunks is unknown")
    try:
        records = decompressors[compression]().decompress(data, MAX_PART_BYTES + 1)
    except (RuntimeError, zstd.ZstdError, EOFError) as err:
        raise ValueError(f"a chunk is damaged ({err})") from err
    if len(records) > MAX_PART_BYTES:
        raise ValueError(f"a part of {len(data)} bytes unpacks to more than {MAX_PART_BYTES >> 20} MiB")
    return records


def _unpacked(decompressor_of: Callable[[], Any], data: bytes) -> bytes:
    parts, left, rest = [], MAX_PART_BYTES, data
    while rest:
        decompressor = decompressor_of()
        parts.append(decompressor.decompress(rest, left + 1))
        left -= len(parts[-1])
        if left < 0:
            raise ValueError(f"a part of {len(data)} bytes unpacks to more than {MAX_PART_BYTES >> 20} MiB")
        if not decompressor.eof:
            raise ValueError(f"a compressed part of {len(data)} bytes is cut off")
        rest = decompressor.unused_data or b""
    return parts[0] if len(parts) == 1 else b"".join(parts)


def _size_of(file: IO[bytes]) -> int:
    here = file.tell()
    size = file.seek(0, 2)
    file.seek(here)
    return size


class _LimitedFile:
    """A compressed file that gives no more than is allowed."""

    def __init__(self, file: Any, size: int) -> None:
        self._file = file
        self._size = size
        self._limit = self._left = max(MAX_RATIO * size, MAX_PART_BYTES)

    def read(self, count: int) -> bytes:
        content = self._file.read(count)
        self._left -= len(content)
        if self._left < 0:
            raise ValueError(f"a file of {self._size} bytes unpacks to more than {self._limit >> 20} MiB")
        return content

    def __enter__(self) -> _LimitedFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
