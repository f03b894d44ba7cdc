"""Bags whose compressed parts unpack to gigabytes, as cases."""

from __future__ import annotations

import bz2
import functools
import sqlite3
import struct
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import lz4.frame

from tests.corpus.cases import Case
from tests.corpus.commands import commands

try:
    from compression import zstd
except ImportError:
    from backports import zstd

_PIECE = 64 << 20
_NUM_PIECES = 64
"""Pieces of zeros, 4 GiB together."""


@functools.cache
def bomb(kind: str) -> bytes:
    """4 GiB of zeros in some hundred kilobytes: one frame after another, or one with all."""
    if kind == "lz4":
        packer = lz4.frame.LZ4FrameCompressor(block_size=lz4.frame.BLOCKSIZE_MAX4MB)
        head, piece = packer.begin(), packer.compress(bytes(4 << 20))
        return head + (piece or packer.compress(bytes(4 << 20))) * (_NUM_PIECES * 4) + packer.flush()
    pack: Callable[[bytes], bytes] = bz2.compress if kind == "bz2" else zstd.compress
    return pack(bytes(_PIECE)) * _NUM_PIECES


def bag_cases(paths: dict[str, Path], canary: Path) -> Iterator[Case]:
    """ROS 1 bags, ROS 2 bags and MCAP files with such parts.

    Args:
        paths: the good inputs.
        canary: a folder that nothing may read or write.
    """
    del canary
    for kind in ("bag1", "bag1-bz2"):
        for form in ("lz4", "bz2", "none", "zip"):
            change = partial(_chunk_of_ros_1, form)
            yield Case(f"{kind}: a chunk of 4 GiB, {form}", kind, change, *commands(kind, paths))
        for label, at in (("the index", b"index_pos="), ("the chunk", b"size=")):
            yield Case(f"{kind}: {label} far away", kind, partial(_far, at), *commands(kind, paths))
    for kind in ("mcap", "mcap-zstd"):
        for form in ("lz4", "zstd"):
            yield Case(f"{kind}: a chunk of 4 GiB, {form}", kind, partial(_chunk_of_mcap, form), *commands(kind, paths))
    yield Case("bag-file: 4 GiB", "bag-file", _file_of_ros_2, *commands("bag-file", paths))
    yield Case("bag-message: 4 GiB", "bag-message", _messages_of_ros_2, *commands("bag-message", paths))


def _chunk_of_ros_1(form: str, folder: Path) -> None:
    """The first chunk holds something else, and says that it is packed in this form."""
    path = folder / "walk.bag"
    content = path.read_bytes()
    start = content.index(b"op=\x05") - 4
    while not content[start - 4 :].startswith(struct.pack("<I", _header_length(content, start))):
        start -= 1
    length = _header_length(content, start)
    size_at = start + length
    (size,) = struct.unpack_from("<I", content, size_at)
    fields = [b"op=\x05", b"compression=" + form.encode(), b"size=" + struct.pack("<I", 0xFFFFFFF0)]
    header = b"".join(struct.pack("<I", len(each)) + each for each in fields)
    data = bomb(form) if form in ("lz4", "bz2") else bytes(1000)
    chunk = struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data
    shift = len(chunk) - (4 + length + 4 + size)
    at = content.index(b"index_pos=") + len(b"index_pos=")
    (index,) = struct.unpack_from("<Q", content, at)
    content = content[:at] + struct.pack("<Q", index + shift) + content[at + 8 :]
    path.write_bytes(content[: start - 4] + chunk + content[size_at + 4 + size :])


def _header_length(content: bytes, start: int) -> int:
    """Length of the header that begins here with fields of a chunk."""
    at = start
    while at < start + 200:
        (length,) = struct.unpack_from("<I", content, at)
        if length > 100 or b"=" not in content[at + 4 : at + 4 + length]:
            break
        at += 4 + length
    return at - start


def _far(name: bytes, folder: Path) -> None:
    path = folder / "walk.bag"
    content = path.read_bytes()
    at = content.index(name) + len(name)
    path.write_bytes(content[:at] + b"\xff\xff\xff\x7f" + content[at + 4 :])


def _chunk_of_mcap(form: str, folder: Path) -> None:
    """Every chunk holds something else; the index that says where they lie is left out."""
    (path,) = (folder / "walk").glob("*.mcap")
    content = path.read_bytes()
    magic = b"\x89MCAP0\r\n"
    found, at = [magic], len(magic)
    while at < len(content) - len(magic):
        kind, (length,) = content[at], struct.unpack_from("<Q", content, at + 1)
        record = content[at : at + 9 + length]
        at += 9 + length
        if kind == 6:
            packed, name = bomb(form), form.encode()
            body = record[9 : 9 + 16] + struct.pack("<QII", _PIECE * _NUM_PIECES, 0, len(name)) + name
            body += struct.pack("<Q", len(packed)) + packed
            found.append(b"\x06" + struct.pack("<Q", len(body)) + body)
        elif kind == 15:  # The end of the data; what follows is the summary.
            break
        elif kind in (1, 3, 4):
            found.append(record)
    footer = b"\x02" + struct.pack("<Q", 20) + bytes(20) + magic
    path.write_bytes(b"".join(found) + footer)


def _file_of_ros_2(folder: Path) -> None:
    (path,) = (folder / "walk").glob("*.zstd")
    path.write_bytes(bomb("zstd"))


def _messages_of_ros_2(folder: Path) -> None:
    (path,) = (folder / "walk").glob("*.db3")
    with sqlite3.connect(path) as base:
        base.execute("UPDATE messages SET data = ?", (bomb("zstd"),))
    base.close()
