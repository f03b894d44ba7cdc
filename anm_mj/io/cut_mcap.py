"""MCAP files that end in the middle, as a killed recorder or a full disk leaves them: read up to the cut.

What is missing, the index at the end, is made again from the chunks that are there (mcap.dev/spec). A chunk that is cut
itself is unpacked as far as it goes.
"""

import io
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from anm_mj.io.bag_limits import unpacked_start
from anm_mj.utils.read_file import open_regular

MAGIC = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _CHUNK_INDEX, _STATISTICS, _FOOTER = 3, 4, 5, 6, 8, 11, 2
_RECORD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQI")
"""First and last time of its messages [ns], unpacked size and checksum."""
_LARGEST_HEADER = 1 << 24
"""Of records that are no chunks, so much is read [bytes]."""


def is_cut(path: Path) -> bool:
    """Whether a file begins as an MCAP file and does not end as one; raises OSError."""
    with open_regular(path) as file:
        start = file.read(len(MAGIC))
        size = file.seek(0, 2)
        file.seek(max(0, size - len(MAGIC)))
        return start == MAGIC and (size < 2 * len(MAGIC) or file.read() != MAGIC)


@dataclass(frozen=True)
class CutMcap:
    """A cut file as the package rosbags reads files: with an index made anew behind what is whole of it."""

    path: Path
    size: int
    """So much of the file is whole [bytes]."""
    tail: bytes = field(repr=False)
    """Stands behind that."""
    messages: int

    @property
    def suffix(self) -> str:
        """That of the file."""
        return self.path.suffix

    def exists(self) -> bool:
        """It was there."""
        return True

    def is_dir(self) -> bool:
        """It is none."""
        return False

    def open(self, mode: str) -> io.BufferedReader:
        """The whole part and the tail as one file, read only."""
        return io.BufferedReader(_Joined(open_regular(self.path), self.size, self.tail))


def mended(path: Path) -> CutMcap:
    """Index a cut file. Raises OSError if it cannot be read, and ValueError if a chunk before the cut is damaged."""
    scan, beside = _Scan(), 0
    with open_regular(path) as file:
        total = file.seek(0, 2)
        at = len(MAGIC)
        while at + _RECORD.size <= total:
            file.seek(at)
            kind, length = _RECORD.unpack(file.read(_RECORD.size))
            whole = at + _RECORD.size + length <= total
            if kind == _CHUNK:
                content = file.read(min(length, total - at))
                if not whole:
                    scan.cut_chunk(at, content)
                    break
                scan.chunk(at, content)
            elif not whole:
                break
            elif kind == _MESSAGE:
                beside += 1
            elif kind in (_SCHEMA, _CHANNEL) and length < _LARGEST_HEADER:
                scan.record(kind, file.read(length))
            at += _RECORD.size + length
    # Where there are chunks, readers look into those alone.
    return CutMcap(path, at, scan.tail(at), sum(scan.counts.values()) or beside)


@dataclass
class _Scan:
    """What the chunks hold, and the end of the file that says so."""

    declared: dict[tuple[int, int], bytes] = field(default_factory=dict)
    """Schemas and channels by kind and number."""
    counts: Counter[int] = field(default_factory=Counter)
    """Messages by channel."""
    indices: list[bytes] = field(default_factory=list)
    last_chunk: bytes = b""
    """The part of a cut chunk that is whole, as a chunk of its own."""
    start_ns: int = 2**63 - 1
    end_ns: int = 0

    def record(self, kind: int, content: bytes) -> None:
        self.declared[kind, *struct.unpack_from("<H", content)] = _record(kind, content)

    def chunk(self, at: int, content: bytes, *, whole: bool = True) -> bytes:
        """Index a chunk; gives its records."""
        _, _, size, _ = _CHUNK_HEAD.unpack_from(content)
        (name,) = struct.unpack_from("<I", content, _CHUNK_HEAD.size)
        begin = _CHUNK_HEAD.size + 4
        compression = content[begin : begin + name].decode("ascii", "replace")
        data = content[begin + name + 8 :]
        records = unpacked_start(compression, data)
        if whole and len(records) < size:
            raise ValueError(f"its chunk at byte {at} is damaged")
        counts: Counter[int] = Counter()
        times, used = [], 0
        for kind, said, end in _whole_records(records):
            used = end
            if kind == _MESSAGE:
                channel, _, time_ns = struct.unpack_from("<HIQ", said)
                counts[channel] += 1
                times.append(time_ns)
            elif kind in (_SCHEMA, _CHANNEL):
                self.record(kind, said)
        if not times:
            return b""
        self.counts += counts
        first, last = min(times), max(times)
        self.start_ns, self.end_ns = min(self.start_ns, first), max(self.end_ns, last)
        if not whole:
            compression, data, size = "", records[:used], used
        length = _RECORD.size + (len(content) if whole else _CHUNK_HEAD.size + 12 + used)
        offset, offsets = at + length, b""
        for channel, count in counts.items():
            offsets += struct.pack("<HQ", channel, offset)
            # Readers take the count of messages from the distance between the indices.
            offset += _RECORD.size + 6 + 16 * count
        index = struct.pack("<QQQQI", first, last, at, length, len(offsets)) + offsets
        index += struct.pack("<Q", offset - at - length) + _text(compression) + struct.pack("<QQ", len(data), size)
        self.indices.append(_record(_CHUNK_INDEX, index))
        head = _CHUNK_HEAD.pack(first, last, size, 0) + _text(compression) + struct.pack("<Q", len(data))
        return b"" if whole else _record(_CHUNK, head + data)

    def cut_chunk(self, at: int, content: bytes) -> None:
        """Index what is whole in a chunk that ends in the middle."""
        if len(content) > _CHUNK_HEAD.size + 12:
            self.last_chunk = self.chunk(at, content, whole=False)

    def tail(self, at: int) -> bytes:
        """All that stands behind the whole part of the file, which ends at ``at``."""
        declared = b"".join(self.declared[key] for key in sorted(self.declared))
        kinds = Counter(kind for kind, _ in self.declared)
        counts = b"".join(struct.pack("<HQ", channel, count) for channel, count in self.counts.items())
        numbers = struct.pack("<QHIIII", sum(self.counts.values()), kinds[_SCHEMA], kinds[_CHANNEL], 0, 0,
                              len(self.indices))  # fmt: skip
        times = struct.pack("<QQI", self.start_ns, self.end_ns, len(counts))
        summary = declared + b"".join(self.indices) + _record(_STATISTICS, numbers + times + counts)
        # Messages beside chunks have no index; a reader finds them one by one.
        begin = at + len(self.last_chunk) if self.indices else 0
        footer = _record(_FOOTER, struct.pack("<QQI", begin, 0, 0))
        return self.last_chunk + (summary if self.indices else b"") + footer + MAGIC


def _whole_records(data: bytes) -> Iterator[tuple[int, bytes, int]]:
    """Kind and content of each record, and where it ends; without one that is cut."""
    at = 0
    while at + _RECORD.size <= len(data):
        kind, length = _RECORD.unpack_from(data, at)
        at += _RECORD.size + length
        if at > len(data):
            return
        yield kind, data[at - length : at], at


def _record(kind: int, content: bytes) -> bytes:
    return _RECORD.pack(kind, len(content)) + content


def _text(words: str) -> bytes:
    return struct.pack("<I", len(words)) + words.encode()


class _Joined(io.RawIOBase):
    """The first bytes of a file, and others behind them."""

    def __init__(self, file: io.BufferedReader, size: int, tail: bytes) -> None:
        self._file, self._size, self._tail, self._at = file, size, tail, 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        base = {io.SEEK_SET: 0, io.SEEK_CUR: self._at, io.SEEK_END: self._size + len(self._tail)}[whence]
        self._at = base + offset
        return self._at

    def readinto(self, buffer: Any) -> int:
        if self._at < self._size:
            self._file.seek(self._at)
            data = self._file.read(min(len(buffer), self._size - self._at))
        else:
            begin = self._at - self._size
            data = self._tail[begin : begin + len(buffer)]
        buffer[: len(data)] = data
        self._at += len(data)
        return len(data)

    def close(self) -> None:
        self._file.close()
        super().close()
