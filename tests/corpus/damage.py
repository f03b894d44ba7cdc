"""Ways to damage a file: of bytes, of JSON and TOML values, of numbers in text."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Iterator
from typing import Any

import numpy as np

WRONG_VALUES: tuple[Any, ...] = (
    None,
    True,
    -1,
    0,
    10**30,
    1e308,
    float("nan"),
    float("inf"),
    "",
    "x" * 5000,
    "../../../etc/passwd",
    "\0",
    [],
    [[[]]],
    {},
    [None, "a", {}],
    {"__class__": "os.system"},
)


def damaged_bytes(content: bytes, rng: np.random.Generator, flips: int = 8) -> Iterator[tuple[str, bytes]]:
    """Truncations, flipped bits, and content of another kind."""
    yield "empty", b""
    for share in (0.01, 0.1, 0.5, 0.9, 0.99):
        yield f"truncated to {share:g}", content[: int(len(content) * share)]
    for number in range(flips if content else 0):
        flipped = np.frombuffer(content, np.uint8).copy()
        where = rng.integers(len(flipped), size=1 + number * len(flipped) // 400)
        flipped[where] ^= (1 << rng.integers(8, size=len(where))).astype(np.uint8)
        yield f"{len(where)} bits flipped", flipped.tobytes()
    yield "noise", rng.bytes(3000)
    yield "zeros", bytes(3000)
    yield "a picture", b"\x89PNG\r\n\x1a\n" + content[:200]
    yield "a pickle", b"\x80\x04\x95\x1c\x00\x00\x00\x00\x00\x00\x00\x8c\x05posix\x8c\x06system\x93\x8c\x04true\x85R."
    yield "a page", b"<!DOCTYPE html><html><body>404</body></html>"
    yield "not UTF-8", b"\xff\xfe\xfa" + content
    yield "twice", content + content


def damaged_values(value: Any, rng: np.random.Generator, num: int) -> Iterator[tuple[str, Any]]:
    """A JSON-like value with one entry replaced by a wrong one, or left out."""
    places = list(_places(value))
    for _ in range(num):
        path = places[rng.integers(len(places))]
        wrong = WRONG_VALUES[rng.integers(len(WRONG_VALUES))]
        if not path:
            yield f"all is {_short(wrong)}", wrong
            continue
        changed = copy.deepcopy(value)
        holder = changed
        for key in path[:-1]:
            holder = holder[key]
        if rng.random() < 0.25:
            del holder[path[-1]]
            yield f"without {_named(path)}", changed
        else:
            holder[path[-1]] = wrong
            yield f"{_named(path)} is {_short(wrong)}", changed


def damaged_json(text: str, rng: np.random.Generator, num: int) -> Iterator[tuple[str, bytes]]:
    """JSON with wrong values, deep nesting, and numbers that JSON does not know."""
    for label, value in damaged_values(json.loads(text), rng, num):
        yield label, json.dumps(value).encode()
    yield "deep list", b"[" * 100_000
    yield "deep object", b'{"a":' * 50_000 + b"1" + b"}" * 50_000
    yield "long number", re.sub(r"\d+\.\d+", "9" * 6000, text, count=1).encode()
    yield "key twice", text.replace("{", '{"name": 1, "name": [], ', 1).encode()


def damaged_numbers(text: str, rng: np.random.Generator, num: int) -> Iterator[tuple[str, bytes]]:
    """Text with one of its numbers replaced."""
    spans = [match.span() for match in re.finditer(r"-?\d+(\.\d+)?(e-?\d+)?", text)]
    wrong = ("nan", "inf", "-inf", "1e308", "-1", "0", "999999999999", "", "0x10", "one", "1e-320")
    for _ in range(num if spans else 0):
        start, end = spans[rng.integers(len(spans))]
        new = wrong[rng.integers(len(wrong))]
        yield f"number at {start} is {new or 'nothing'}", (text[:start] + new + text[end:]).encode()


def _places(value: Any, path: tuple = ()) -> Iterator[tuple]:
    """The paths of all entries; of long lists the first, the last and one more."""
    yield path
    if isinstance(value, dict):
        for key, entry in value.items():
            yield from _places(entry, (*path, key))
    elif isinstance(value, list):
        for index in sorted({0, len(value) // 2, len(value) - 1} if value else ()):
            yield from _places(value[index], (*path, index))


def _named(path: tuple) -> str:
    return ".".join(map(str, path))


def _short(value: Any) -> str:
    return repr(value)[:24]
