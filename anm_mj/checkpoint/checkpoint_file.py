"""A checkpoint as a file: a line that names the format, the state, and a hash of all of it.

The layout is: :data:`MAGIC`; the length of the header as eight bytes, little end first; the header in JSON with the
nodes of the graph, the sizes of its arrays and facts about the run; the arrays one behind the other; the SHA-256 of
everything before. Files are written beside their final name, forced to the disk and then renamed.
"""

import contextlib
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
from anm_mj.utils.files import removed_on_error, sync
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
    step: Annotated[int, Meta(ge=0, le=10**9)]
    facts: dict[str, Any]
    sizes: list[_Count]
    nodes: Annotated[list[list[Any]], Meta(min_length=1)]


def write_draft(draft: Path, step: int, facts: dict[str, Any], graph: Graph) -> None:
    """Write the content of a checkpoint, without its hash; the state may change as soon as this returns. Raises OSError
    if the file cannot be written; nothing is left of it.
    """
    sizes = [array.nbytes for array in graph.arrays]
    header = {"step": step, "facts": facts, "sizes": sizes, "nodes": graph.nodes}
    text = json.dumps(header, separators=(",", ":")).encode()
    with removed_on_error(draft), draft.open("wb") as file:
        for part in (MAGIC, struct.pack("<Q", len(text)), text, *(array.data for array in graph.arrays)):
            file.write(part)


def complete_draft(draft: Path, path: Path) -> int:
    """Add the hash of a draft, force it to the disk and give it its name. Returns its size [bytes]. Raises OSError if
    the file cannot be read or written; nothing is left of the draft.
    """
    with removed_on_error(draft):
        with draft.open("r+b") as file:
            digest = hashlib.file_digest(file, "sha256")
            file.seek(0, os.SEEK_END)
            file.write(digest.digest())
            size = file.tell()
        sync(draft)
        draft.replace(path)
    # Not every system can do this with a folder.
    with contextlib.suppress(OSError):
        sync(path.parent)
    return size


def read_checkpoint(path: Path) -> StoredState:
    """Read a checkpoint. Raises CheckpointError if it is none of this version, or not whole."""
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
