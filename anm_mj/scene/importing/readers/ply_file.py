"""The header of a PLY file, and the rows of its elements as numbers."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float64, Int64

CORNERS = ("vertex_indices", "vertex_index")
"""What the list of a face's vertices may be called."""
_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4"},
    **{"double": "f8", "float64": "f8", "float16": "f2", "int64": "i8", "uint64": "u8"},
}
_AT_ONCE = 1 << 20
"""Numbers that are gathered in one step."""


@dataclass
class PlyElement:
    """An element of the header, such as "vertex" or "face"."""

    name: str
    stated: int | None
    """Stated number of rows; None where it is no number."""
    properties: list[list[str]] = field(default_factory=list)
    """Words of each property without the first: type and name, or "list", two types and name."""

    @property
    def has_lists(self) -> bool:
        """Whether rows may be of different lengths."""
        return any(words[:1] == ["list"] for words in self.properties)


@dataclass
class PlyHeader:
    """What a PLY file says of itself before its rows."""

    lines: list[str]
    elements: list[PlyElement]
    length: int
    """Bytes before the rows."""

    @cached_property
    def order(self) -> str:
        """Byte order of the numbers as numpy writes it, ``<`` or ``>``; empty for a text."""
        kinds = [words[1] for line in self.lines if len(words := line.split()) > 1 and words[0] == "format"]
        return {"binary_little_endian": "<", "binary_big_endian": ">"}.get(kinds[0], "") if kinds else ""

    @cached_property
    def pictures(self) -> list[str]:
        """Names of pictures, each once."""
        notes = [line for line in self.lines if line.split()[:1] not in (["element"], ["property"])]
        places = [(line, line.lower().find("texturefile")) for line in notes]
        return list(dict.fromkeys(line[at + len("texturefile") :].strip() for line, at in places if at >= 0))

    def element(self, name: str) -> PlyElement | None:
        """The first element of a name; None without one."""
        return next((element for element in self.elements if element.name == name), None)


def ply_header(head: bytes) -> PlyHeader:
    """The header in the beginning of a PLY file, as far as it goes."""
    text, end, rest = head.partition(b"end_header")
    lines = text.decode("latin-1").splitlines()
    elements: list[PlyElement] = []
    for words in (line.split() for line in lines):
        if words[:1] == ["element"]:
            is_stated = len(words) == 3 and words[2].isdecimal() and len(words[2]) < 19
            elements.append(PlyElement(" ".join(words[1:2]), int(words[2]) if is_stated else None))
        elif words[:1] == ["property"] and elements:
            elements[-1].properties.append(words[1:])
    return PlyHeader(lines, elements, len(text) + len(end) + rest.find(b"\n") + 1)


@dataclass(frozen=True)
class PlyColumn:
    """The numbers that the rows of an element have for one property."""

    counts: Int64[np.ndarray, " n"]
    """How many each row has."""
    values: Any
    """All of them, row by row, in the type of the file."""

    @cached_property
    def starts(self) -> Int64[np.ndarray, " n"]:
        """Where the values of each row begin."""
        return np.cumsum(self.counts) - self.counts


def points_of(content: bytes, at: int, element: PlyElement, order: str) -> tuple[Float64[np.ndarray, "v 3"], int]:
    """The x, y and z of a binary file's vertices, whose rows begin at byte ``at``, and where they end.

    Raises ValueError or LookupError if they are not all there, or have lists.
    """
    if element.has_lists:
        raise ValueError("its vertices have lists")
    number, kind = element.stated or 0, row_type(element, order)
    if at + number * kind.itemsize > len(content):
        raise ValueError("it ends before its vertices do")
    rows = np.frombuffer(content, kind, number, at)
    points = np.column_stack([rows[axis].astype(np.float64) for axis in "xyz"])
    return points, at + number * kind.itemsize


def row_type(element: PlyElement, order: str, lengths: dict[str, int] | None = None) -> np.dtype[Any]:
    """The type of an element's row, whose lists have ``lengths`` by name: a count, named with "#", and the numbers.
    Raises KeyError for a type that PLY does not know.
    """
    fields: list[Any] = []
    for words in element.properties:
        kind = order + _TYPES[words[-2]]
        if words[:1] == ["list"]:
            fields += [(f"#{words[-1]}", order + _TYPES[words[1]]), (words[-1], kind, ((lengths or {})[words[-1]],))]
        else:
            fields.append((words[-1], kind))
    return np.dtype(fields)


def columns_of(content: bytes, at: int, element: PlyElement, order: str) -> tuple[dict[str, PlyColumn], int]:
    """The columns of an element by name, whose rows begin at byte ``at`` of a binary file, and where these end. Raises
    ValueError or LookupError if they are not all there.
    """
    number = element.stated or 0
    kinds = [np.dtype(order + _TYPES[words[-2]]) for words in element.properties]
    heads = [np.dtype(order + _TYPES[words[1]]) if words[:1] == ["list"] else None for words in element.properties]
    least = sum(kind.itemsize if head is None else head.itemsize for kind, head in zip(kinds, heads, strict=True))
    if at + number * least > len(content) or not least:
        raise ValueError(f"it ends before its rows of {element.name} do")
    counts, starts = (np.ones((len(kinds), number), dtype=np.int64) for _ in range(2))
    plan = [
        (kind.itemsize, 0 if head is None else head.itemsize, own, start)
        for kind, head, own, start in zip(kinds, heads, counts, starts, strict=True)
    ]
    side = "big" if order == ">" else "little"
    for row in range(number):
        for size, head, own, start in plan:
            count = 1
            if head:
                count = int.from_bytes(content[at : at + head], side)
                at += head
                own[row] = count
            start[row] = at
            at += count * size
        if at > len(content):
            raise ValueError(f"it ends before row {row + 1} of {element.name} does")
    names = [words[-1] for words in element.properties]
    return {
        name: PlyColumn(own, _gathered(content, own, start, kind))
        for name, own, start, kind in zip(names, counts, starts, kinds, strict=True)
    }, at


def _gathered(
    content: bytes, counts: Int64[np.ndarray, " n"], starts: Int64[np.ndarray, " n"], kind: np.dtype[Any]
) -> Any:
    """The numbers of all rows, ``counts`` of each, which begin at the bytes ``starts``."""
    body, values = np.frombuffer(content, np.uint8), np.empty(int(counts.sum()), kind)
    rows, before = np.repeat(np.arange(len(counts)), counts), np.cumsum(counts) - counts
    for first in range(0, len(values), _AT_ONCE):
        row = rows[first : first + _AT_ONCE]
        places = starts[row] + (np.arange(first, first + len(row)) - before[row]) * kind.itemsize
        values[first : first + len(row)] = body[places[:, None] + np.arange(kind.itemsize)].view(kind)[:, 0]
    return values
