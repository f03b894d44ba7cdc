"""Ways to damage files of arrays that stay well-formed: safetensors, npz, checkpoints with a true hash."""

from __future__ import annotations

import hashlib
import io
import json
import struct
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from tests.corpus.damage import damaged_values

CHECKPOINT_MAGIC = b"anm-mj checkpoint 1\n"
_HASH_BYTES = 32


def damaged_arrays(
    arrays: dict[str, np.ndarray], rng: np.random.Generator, num: int
) -> Iterator[tuple[str, dict[str, np.ndarray]]]:
    """Arrays by name, with one of them changed: its numbers, its type, its shape; or without it."""
    names = sorted(arrays)
    for _ in range(num):
        name = names[rng.integers(len(names))]
        label, change = _CHANGES[rng.integers(len(_CHANGES))]
        changed = change(arrays[name])
        rest = {key: value for key, value in arrays.items() if key != name}
        yield f"{name} {label}", rest if changed is None else {**rest, name: changed}


def _filled(value: float) -> Callable[[np.ndarray], np.ndarray]:
    def fill(array: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            return np.full(array.shape, value).astype(array.dtype)

    return fill


def _one(value: float) -> Callable[[np.ndarray], np.ndarray]:
    def put(array: np.ndarray) -> np.ndarray:
        changed = array.copy()
        if changed.size:
            with np.errstate(all="ignore"):
                changed.reshape(-1)[changed.size // 2] = np.array(value).astype(array.dtype)
        return changed

    return put


_CHANGES: tuple[tuple[str, Callable[[np.ndarray], np.ndarray | None]], ...] = (
    ("is all NaN", _filled(np.nan)),
    ("is all infinite", _filled(np.inf)),
    ("is all 1e30", _filled(1e30)),
    ("is all -1", _filled(-1.0)),
    ("holds one NaN", _one(np.nan)),
    ("holds one of 2e9", _one(2e9)),
    ("holds one of -2e9", _one(-2e9)),
    ("is missing", lambda array: None),
    ("is empty", lambda array: array[:0] if array.ndim else array.reshape(1)[:0]),
    ("is doubled", lambda array: np.concatenate((array, array)) if array.ndim else np.stack((array, array))),
    ("is flat", lambda array: array.reshape(-1)),
    ("has one more axis", lambda array: array[None]),
    ("has its axes swapped", lambda array: np.ascontiguousarray(array.T)),
    ("is of float64", lambda array: array.astype(np.float64)),
    ("is of int8", lambda array: array.astype(np.int8)),
    ("is of uint32", lambda array: array.astype(np.uint32)),
    ("is of bool", lambda array: array.astype(bool)),
    ("is a number", lambda array: np.array(3, array.dtype)),
)


def damaged_npz(content: bytes, rng: np.random.Generator, num: int) -> Iterator[tuple[str, bytes]]:
    """An ``.npz`` file with damaged arrays."""
    with np.load(io.BytesIO(content)) as stored:
        arrays = dict(stored)
    for label, changed in damaged_arrays(arrays, rng, num):
        file = io.BytesIO()
        np.savez(file, **changed)  # type: ignore[arg-type]
        yield label, file.getvalue()


def damaged_safetensors(content: bytes, rng: np.random.Generator, num: int) -> Iterator[tuple[str, bytes]]:
    """A ``.safetensors`` file with damaged arrays, with another header, and with other facts in its metadata."""
    from safetensors.numpy import load, save

    length = struct.unpack("<Q", content[:8])[0]
    header = json.loads(content[8 : 8 + length])
    facts = header.get("__metadata__", {})
    for label, changed in damaged_arrays(load(content), rng, 2 * num):
        yield label, save({name: np.ascontiguousarray(array) for name, array in changed.items()}, facts)

    def packed(value: Any) -> bytes:
        text = value if isinstance(value, bytes) else json.dumps(value).encode()
        return struct.pack("<Q", len(text)) + text + content[8 + length :]

    for label, value in damaged_values(header, rng, num):
        yield f"header: {label}", packed(value)
    for key, text in facts.items():
        for label, value in damaged_values(json.loads(text), rng, 2 * num):
            yield f"facts: {label}", packed({**header, "__metadata__": {**facts, key: json.dumps(value)}})
        yield "facts: deep", packed({**header, "__metadata__": {**facts, key: "[" * 100_000}})
    yield "header: deep", packed(b"[" * 100_000)
    yield "header of 10^18 bytes", struct.pack("<Q", 10**18) + content[8:]


def damaged_checkpoint(content: bytes, rng: np.random.Generator, num: int) -> Iterator[tuple[str, bytes]]:
    """A checkpoint with another state, and the hash of that."""
    start = len(CHECKPOINT_MAGIC) + 8
    length = struct.unpack("<Q", content[start - 8 : start])[0]
    header = json.loads(content[start : start + length])
    arrays = content[start + length : -_HASH_BYTES]

    def packed(value: Any, data: bytes = arrays) -> bytes:
        text = value if isinstance(value, bytes) else json.dumps(value).encode()
        whole = CHECKPOINT_MAGIC + struct.pack("<Q", len(text)) + text + data
        return whole + hashlib.sha256(whole).digest()

    nodes = header["nodes"]
    for _ in range(6 * num):
        # Of all nodes each is as likely; a long list of them would be met at three places only.
        place = int(rng.integers(len(nodes)))
        ((label, node),) = damaged_values(nodes[place], rng, 1)
        kind = nodes[place][1] if nodes[place][0] == "object" else nodes[place][0]
        yield (
            f"node {place} ({kind}): {label}",
            packed({**header, "nodes": [*nodes[:place], node, *nodes[place + 1 :]]}),
        )
    rest = {name: value for name, value in header.items() if name != "nodes"}
    for label, value in damaged_values(rest, rng, num):
        yield f"header: {label}", packed({**value, "nodes": nodes} if isinstance(value, dict) else value)
    for label, data in (
        ("noise", rng.bytes(len(arrays))),
        ("zeros", bytes(len(arrays))),
        ("ones", b"\xff" * len(arrays)),
    ):
        yield f"all arrays are {label}", packed(header, data)
    yield "header: deep", packed(b"[" * 100_000)
    for name in ("os:system", "subprocess:Popen", "anm_mj.utils.files:store_in_cache", "anm_mj.cli.main:main"):
        hidden = [["function", name] if node[0] in ("function", "method") else node for node in nodes]
        yield f"functions are {name}", packed({**header, "nodes": hidden})
        shadowed = [_shadowed(node, len(nodes)) for node in nodes]
        yield f"methods are {name}", packed({**header, "nodes": [*shadowed, ["function", name]]})


def _shadowed(node: list[Any], index: int) -> list[Any]:
    """An object whose methods are another function."""
    if node[0] != "object":
        return node
    names = ("observe", "plan", "step", "update", "close", "integrate", "flush", "submit", "json", "line")
    return [*node[:3], {**node[3], **{name: [index] for name in names}}, *node[4:]]
