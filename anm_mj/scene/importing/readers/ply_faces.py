"""Writes a PLY file as the library that reads it expects it, where that is not how it is stored.

The library takes all faces of a binary file to have as many corners as the first, cuts every polygon into a fan about
its first corner, and drops the colours of vertices that have texture coordinates.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float64, Int64

from anm_mj.scene.importing.readers.import_limits import MAX_MESH_MIB, check_triangles
from anm_mj.scene.importing.readers.ply_file import (
    CORNERS,
    PlyColumn,
    PlyElement,
    PlyHeader,
    columns_of,
    ply_header,
    points_of,
    row_type,
)
from anm_mj.scene.importing.readers.polygons import cut_polygons
from anm_mj.utils.read_file import read_bytes

_UV = ({"texture_u", "texture_v"}, {"u", "v"}, {"s", "t"})
_COLOURS = {"red", "green", "blue"}


def even_ply(src: Path) -> bytes | None:
    """A PLY file of triangles and quads that a fan covers, and without texture coordinates where colours stand beside
    them and no picture is named; None if it is so as it is stored.

    Raises OSError or ValueError if it cannot be read, and LimitError if it has too many triangles.
    """
    content = read_bytes(src, MAX_MESH_MIB)
    header = ply_header(content)
    lines = _without_uv(header)
    # Others, and vertices behind faces, are left to the library.
    is_usual = [element.name for element in header.elements[:2]] == ["vertex", "face"]
    try:
        made = (_binary if header.order else _text)(src, content, header) if is_usual else None
    # The library says what is wrong with it.
    except (ValueError, LookupError):
        made = None
    if made is None and lines == header.lines:
        return None
    number, body = made or (header.elements[1].stated, content[header.length :])
    lines = [f"element face {number}" if line.split()[:2] == ["element", "face"] else line for line in lines]
    return "\n".join([*lines, "end_header", ""]).encode("latin-1") + body


def _without_uv(header: PlyHeader) -> list[str]:
    """The lines of the header, with other names for texture coordinates that would take the place of colours."""
    names = {element.name: {words[-1] for words in element.properties} for element in header.elements}
    vertex, face = names.get("vertex", set()), names.get("face", set())
    if header.pictures or not (vertex >= _COLOURS or face >= _COLOURS):
        return header.lines
    hidden = {"vertex": set().union(*(uv for uv in _UV if uv <= vertex)), "face": {"texcoord"}}
    lines, element = [], ""
    for line in header.lines:
        words = line.split()
        element = words[1] if words[:1] == ["element"] else element
        is_hidden = words[:1] == ["property"] and words[-1] in hidden.get(element, ())
        lines.append(" ".join([*words[:-1], f"own_{words[-1]}"]) if is_hidden else line)
    return lines


def _binary(src: Path, content: bytes, header: PlyHeader) -> tuple[int, bytes] | None:
    """The number of triangles in the place of a binary file's faces, and the rows of all elements; None where the faces
    may stay.
    """
    vertex, face, order = *header.elements[:2], header.order
    name = next((words[-1] for words in face.properties if words[-1] in CORNERS), "")
    if not (vertex.stated and face.stated and name):
        return None
    points, start = points_of(content, header.length, vertex, order)
    columns, end, size = _even_columns(content, start, face, order, name)
    if size == 3:
        return None
    if not size:
        columns, end = columns_of(content, start, face, order)
    check_triangles(src, int(np.maximum(columns[name].counts - 2, 0).sum()))
    rows, local, is_cut = _triangles(points, columns[name])
    if size == 4 and not is_cut:
        return None
    made = _rows(face, order, columns, rows, local)
    return len(rows), content[header.length : start] + made + content[end:]


def _even_columns(
    content: bytes, at: int, face: PlyElement, order: str, name: str
) -> tuple[dict[str, PlyColumn], int, int]:
    """The columns of faces that have as many corners and other numbers each as the first, where they end, and how many
    corners that are; none where they have not.
    """
    lengths: dict[str, int] = {}
    first = at
    for words in face.properties:
        own = PlyElement("face", 1, [words])
        column, first = columns_of(content, first, own, order)
        lengths[words[-1]] = int(column[words[-1]].counts[0])
    kind, number = row_type(face, order, lengths), face.stated or 0
    if at + number * kind.itemsize > len(content):
        return {}, at, 0
    rows = np.frombuffer(content, kind, number, at)
    if any((rows[f"#{key}"] != length).any() for key, length in lengths.items() if f"#{key}" in (kind.names or ())):
        return {}, at, 0
    columns = {
        key: PlyColumn(np.full(number, length, dtype=np.int64), rows[key].reshape(-1))
        for key, length in lengths.items()
    }
    return columns, at + number * kind.itemsize, lengths[name]


def _triangles(
    points: Float64[np.ndarray, "v 3"], corners: PlyColumn
) -> tuple[Int64[np.ndarray, " t"], Int64[np.ndarray, "t 3"], bool]:
    """The face that each triangle is of, which of its corners make it, in the order of the faces, and whether a fan
    does not cover one of these.
    """
    rows, locals_, is_cut = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3), dtype=np.int64)], False
    for size in np.unique(corners.counts[corners.counts > 2]).tolist():
        numbers = np.flatnonzero(corners.counts == size)
        index = corners.values[corners.starts[numbers][:, None] + np.arange(size)].astype(np.int64)
        cut = dict(cut_polygons(points, index))
        fan = np.column_stack([np.zeros(size - 2, dtype=np.int64), np.arange(1, size - 1), np.arange(2, size)])
        whole = np.setdiff1d(np.arange(len(numbers)), list(cut))
        rows += [np.repeat(numbers[whole], size - 2), *(np.full(len(own), numbers[row]) for row, own in cut.items())]
        locals_ += [np.tile(fan, (len(whole), 1)), *cut.values()]
        is_cut = is_cut or bool(cut)
    order = np.argsort(np.concatenate(rows), kind="stable")
    return np.concatenate(rows)[order], np.concatenate(locals_)[order], is_cut


def _rows(
    face: PlyElement,
    order: str,
    columns: dict[str, PlyColumn],
    rows: Int64[np.ndarray, " t"],
    local: Int64[np.ndarray, "t 3"],
) -> bytes:
    """Rows of triangles: the corners ``local`` of the faces ``rows``, with what those have besides."""
    lengths = {words[-1]: 6 if words[-1] == "texcoord" else 3 for words in face.properties if words[:1] == ["list"]}
    made = np.zeros(len(rows), row_type(face, order, lengths))
    for words in face.properties:
        name, column = words[-1], columns[words[-1]]
        starts = column.starts[rows]
        if name not in lengths:
            made[name] = column.values[starts]
            continue
        made[f"#{name}"] = lengths[name]
        # Two numbers for each corner, or one; a list of another length is none of corners.
        wide = lengths[name] // 3
        places = (wide * local[:, :, None] + np.arange(wide)).reshape(len(rows), -1)
        is_whole = places.max(axis=1, initial=0) < column.counts[rows]
        made[name][is_whole] = column.values[starts[is_whole, None] + places[is_whole]]
    return made.tobytes()


def _text(src: Path, content: bytes, header: PlyHeader) -> tuple[int, bytes] | None:
    """The same for a text."""
    vertex, face = header.elements[:2]
    if not (vertex.stated and face.stated):
        return None
    lines = content[header.length :].decode("latin-1").splitlines()
    first, end = vertex.stated, vertex.stated + face.stated
    faces = {
        number: own for number in range(first, end) if (own := _corners(lines[number].split(), face)) and len(own) > 3
    }
    if not faces:
        return None
    check_triangles(src, face.stated + sum(len(corners) - 3 for corners in faces.values()))
    columns = [next(k for k, words in enumerate(vertex.properties) if words[-1] == axis) for axis in "xyz"]
    words = [line.split() for line in lines[:first]]
    points = np.array([[own[column] for column in columns] for own in words], dtype=np.float64)
    counts = np.array([len(corners) for corners in faces.values()], dtype=np.int64)
    values = np.array([corner for corners in faces.values() for corner in corners], dtype=np.int64)
    rows, local, is_cut = _triangles(points, PlyColumn(counts, values))
    # The library cuts faces of different numbers of corners, but none of more than four each.
    if not is_cut and not (len(faces) == face.stated and counts.min() == counts.max() > 4):
        return None
    numbers = list(faces)
    made: dict[int, list[str]] = {}
    for row, corners in zip(rows.tolist(), local.tolist(), strict=True):
        number = numbers[row]
        made.setdefault(number, []).append(_row(lines[number].split(), face, corners))
    cut = [own for number in range(first, end) for own in made.get(number, [lines[number]])]
    return len(cut), "\n".join([*lines[:first], *cut, *lines[end:], ""]).encode("latin-1")


def _spans(words: list[str], face: PlyElement) -> Iterator[tuple[list[str], int, int]]:
    """Each property of a face, which of its words is the first number, and how many numbers it has."""
    at = 0
    for own in face.properties:
        is_list = own[:1] == ["list"]
        number, at = (int(words[at]), at + 1) if is_list else (1, at)
        yield own, at, number
        at += number


def _corners(words: list[str], face: PlyElement) -> list[int]:
    spans = [(at, number) for own, at, number in _spans(words, face) if own[-1] in CORNERS]
    return [int(word) for at, number in spans[:1] for word in words[at : at + number]]


def _row(words: list[str], face: PlyElement, corners: Sequence[int]) -> str:
    """A face of some of the corners of another, with what that has besides; as :func:`_rows`."""
    made: list[str] = []
    for own, at, number in _spans(words, face):
        if own[:1] != ["list"]:
            made.append(words[at])
            continue
        wide = 2 if own[-1] == "texcoord" else 1
        places = [wide * corner + k for corner in corners for k in range(wide)]
        is_whole = max(places) < number
        made += [str(len(places)), *(words[at + place] if is_whole else "0" for place in places)]
    return " ".join(made)
