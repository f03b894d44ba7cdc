"""A checkpoint as a file: a line that names the format, the state, and a hash of all of it.

The layout is: :data:`MAGIC`; the length of the header as eight bytes, little end first; the header in JSON with the
nodes of the graph, the sizes of its arrays and facts about the run; the arrays one behind the other; the SHA-256 of
everything before. Files are written beside their final name, forced to the disk and then renamed.
"""

from __future__ import annotations

import hashlib
import json
import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, BinaryIO

import numpy as np
from msgspec import Meta, Struct

from anm_mj.checkpoint.encode import Graph
from anm_mj.errors import CheckpointError
from anm_mj.utils.files import atomic_write
from anm_mj.utils.read_file import convert, open_regular, parse_json

MAGIC = b"anm-mj checkpoint 1\n"
"""First bytes of a checkpoint of this version."""
_HASH_BYTES = hashlib.sha256().digest_size
_MAX_HEADER_BYTES = 1 << 30
_Count = Annotated[int, Meta(ge=0, le=1 << 50)]


@dataclass(frozen=True)
class StoredState:
    """The content of a checkpoint."""

    step: int
    """Number of actions before it."""
    facts: dict[str, Any]
    """What the run was made of."""
    nodes: list[Any]
    arrays: list[np.ndarray]


class _Header(Struct):
    """The header of a checkpoint."""

    step: Annotated[int, Meta(ge=0, le=10**9)]
    facts: dict[str, Any]
    sizes: list[_Count]
    nodes: Annotated[list[list[Any]], Meta(min_length=1)]


def write_checkpoint(path: Path, step: int, facts: dict[str, Any], graph: Graph) -> int:
    """Write a checkpoint, whole or not at all, and force it to the disk.

    Returns:
        Its size [bytes].

    Raises:
        OSError: The file cannot be written.
    """
    sizes = [array.nbytes for array in graph.arrays]
    header = {"step": step, "facts": facts, "sizes": sizes, "nodes": graph.nodes}
    text = json.dumps(header, separators=(",", ":")).encode()
    digest = hashlib.sha256()
    with atomic_write(path) as partial, partial.open("wb") as file:
        for part in (MAGIC, struct.pack("<Q", len(text)), text, *(array.data for array in graph.arrays)):
            digest.update(part)
            file.write(part)
        file.write(digest.digest())
        file.flush()
        os.fsync(file.fileno())
        size = file.tell()
    sync_folder(path.parent)
    return size


def sync_folder(path: Path) -> None:
    """Force the names in a folder to the disk, where the system can."""
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(descriptor)
    except OSError:
        pass
    finally:
        os.close(descriptor)


def read_checkpoint(path: Path) -> StoredState:
    """Read a checkpoint and check that it is whole.

    Raises:
        CheckpointError: It is no checkpoint of this version, or damaged.
    """
    try:
        with open_regular(path) as file:
            return _read(file, os.fstat(file.fileno()).st_size)
    except (OSError, ValueError, struct.error) as err:
        raise CheckpointError(f"It cannot be read ({err}).") from err


def _read(file: BinaryIO, size: int) -> StoredState:
    digest = hashlib.sha256()

    def take(count: int) -> bytes:
        data = file.read(count)
        if len(data) != count:
            raise CheckpointError("It is cut off.")
        digest.update(data)
        return data

    if take(min(len(MAGIC), size)) != MAGIC:
        raise CheckpointError(f"It does not begin with {MAGIC.decode().strip()!r}.")
    length = struct.unpack("<Q", take(8))[0]
    if length > min(size, _MAX_HEADER_BYTES):
        raise CheckpointError("It is cut off.")
    header = convert(parse_json(take(length)), _Header)
    sizes = header.sizes
    if file.tell() + sum(sizes) + _HASH_BYTES != size:
        raise CheckpointError("It is cut off.")
    arrays = [np.frombuffer(take(each), np.uint8) for each in sizes]
    if file.read(_HASH_BYTES) != digest.digest():
        raise CheckpointError("Its hash is another: it is damaged.")
    return StoredState(header.step, header.facts, header.nodes, arrays)
