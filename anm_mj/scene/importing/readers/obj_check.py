"""Checks an OBJ file before it is read, and writes its lines as the library expects them."""

import re
from pathlib import Path

import mapbox_earcut
import numpy as np
from jaxtyping import Bool, Float64, Int64

from anm_mj.errors import SceneError
from anm_mj.scene.importing.readers.import_limits import MAX_MESH_MIB, check_parts
from anm_mj.scene.importing.readers.import_report import LEFT_OUT, ImportReport, MeshFacts
from anm_mj.scene.raster import normals
from anm_mj.utils.read_file import open_regular, read_bytes

_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_NOT_READ = (b"surf ", b"fo ", b"bzp ", b"bsp ", b"call ")
"""Keywords of free-form surfaces, of obsolete faces, and of other files."""
_LIBRARY = re.compile(rb"(?m)^mtllib +(.*)$")
_MAX_CORNERS = 10_000
"""Cutting a polygon takes time that grows with the square of its corners."""
_BEYOND = 1e-6
"""A triangle of a fan is turned around by more than this share of the polygon where the fan reaches beyond it."""
_VERTEX_ZERO = re.compile(rb"\s0+(?:/|\s|$)")


def check_obj(src: Path, report: ImportReport) -> MeshFacts:
    """Look at every line of an OBJ file, and note the surfaces that are not read. Raises SceneError if it changes its
    material too often, a vertex has less than three numbers, or a face names vertex 0.
    """
    parts, libraries, uneven = 0, 0, False
    with open_regular(src) as file:
        for number, line in enumerate(file, 1):
            # trimesh finds a line by what stands first in it, with a space behind.
            if line[0] in b" \t" or b"\t" in line or (number == 1 and line.startswith(_BYTE_ORDER_MARK)):
                uneven = True
                line = line.removeprefix(_BYTE_ORDER_MARK).strip().replace(b"\t", b" ")
            if line.startswith(b"usemtl"):
                parts += 1
            elif line.startswith(_NOT_READ):
                report.add(LEFT_OUT, f"{line.split()[0].decode()!r} in line {number} of {src.name}")
            elif line.startswith(b"v ") and len(line.split()) < 4 and not line.rstrip().endswith(b"\\"):
                raise SceneError(
                    f"{src}, line {number}: a vertex has {len(line.split()) - 1} numbers instead of 3: export it again."
                )
            elif line.startswith(b"f "):
                corners = len(line.split()) - 1
                if corners > _MAX_CORNERS:
                    raise SceneError(
                        f"{src}, line {number}: a face has {corners} corners, but faces end at {_MAX_CORNERS}: export "
                        "it with triangles."
                    )
                if b" 0" in line and _VERTEX_ZERO.search(line):
                    raise SceneError(
                        f"{src}, line {number}: a face names vertex 0, but OBJ counts from 1: export it again."
                    )
                uneven = uneven or not _is_plain_face(line)
            elif line.startswith(b"mtllib "):
                uneven, libraries = uneven or libraries > 0, libraries + 1
    check_parts(src, parts)
    return MeshFacts(uneven=uneven)


def even_text(src: Path) -> bytes:
    """An OBJ file as the library expects it.

    Without byte order mark, tabs, spaces before a line, and lines that go on in the next; with one line of material
    files, vertices counted from 1, and polygons that a fan covers: the library counts negative indices from the end of
    the file, where OBJ counts them from the line that they stand in, and cuts every polygon into a fan about its first
    corner, which reaches beyond one that is not convex. Raises ValueError if it cannot be read.
    """
    text = read_bytes(src, MAX_MESH_MIB).removeprefix(_BYTE_ORDER_MARK).replace(b"\t", b" ")
    text = text.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    text = re.sub(rb"(?m)^ +", b"", text)
    libraries = list(dict.fromkeys(name.strip() for name in _LIBRARY.findall(text)))
    if len(libraries) > 1:
        text = b"mtllib " + b" ".join(libraries) + b"\n" + _LIBRARY.sub(b"", text)
    return _with_plain_faces(text)


def _is_plain_face(line: bytes) -> bool:
    """Whether a face is a triangle that names its vertices from 1 and has no comment behind it."""
    return b"-" not in line and b"#" not in line and len(line.split()) <= 4


def _with_plain_faces(text: bytes) -> bytes:
    lines = text.split(b"\n")
    vertices: list[bytes] = []
    others = {b"vt": 0, b"vn": 0}
    polygons: dict[int, list[int]] = {}
    for number, line in enumerate(lines):
        if line.startswith(b"v "):
            vertices.append(line)
        elif line.startswith((b"vt ", b"vn ")):
            others[line[:2]] += 1
        elif line.startswith(b"f ") and not _is_plain_face(line):
            corners = line.partition(b"#")[0].split()[1:]
            seen = (len(vertices), others[b"vt"], others[b"vn"])
            lines[number] = b"f " + b" ".join(
                _from_one(corner, seen) if b"-" in corner else corner for corner in corners
            )
            if len(corners) > 3:
                polygons.setdefault(len(corners), []).append(number)
    if polygons:
        points = np.array([line.split()[1:4] for line in vertices], dtype=np.float64)
        for numbers in polygons.values():
            _cut(lines, numbers, points)
    return b"\n".join(lines)


def _from_one(corner: bytes, seen: tuple[int, int, int]) -> bytes:
    """A corner such as -1/-1 with indices from 1; above it stand ``seen`` vertices, texture coordinates and normals."""
    words = []
    for word, number in zip(corner.split(b"/"), seen, strict=False):
        index = int(word) if word else 0
        if number + index < 0:
            raise ValueError(f"a face names entry {index}, but {number} stand above it")
        words.append(b"%d" % (number + index + 1) if index < 0 else word)
    return b"/".join(words)


def _cut(lines: list[bytes], numbers: list[int], points: Float64[np.ndarray, "v 3"]) -> None:
    """Cut those of the polygons in the lines ``numbers``, of as many corners each, that a fan does not cover."""
    corners = [lines[number].split()[1:] for number in numbers]
    index = np.array([[int(corner.partition(b"/")[0]) for corner in own] for own in corners]) - 1
    if index.min() < 0 or index.max() >= len(points):
        return  # The library refuses it.
    outlines = points[index]
    normals = np.cross(outlines, np.roll(outlines, -1, axis=1)).sum(axis=1)
    for own in np.flatnonzero(_exceeded_by_fan(outlines, normals)):
        triangles = _ears(outlines[own], normals[own])
        if len(triangles):
            lines[numbers[own]] = b"\n".join(
                b"f " + b" ".join(corners[own][corner] for corner in triangle) for triangle in triangles
            )


def _exceeded_by_fan(
    outlines: Float64[np.ndarray, "n k 3"], normals: Float64[np.ndarray, "n 3"]
) -> Bool[np.ndarray, " n"]:
    """Whether a fan about the first corner of a polygon has a triangle that lies the other way round."""
    spokes = outlines[:, 1:] - outlines[:, :1]
    turned = np.cross(spokes[:, :-1], spokes[:, 1:])
    return (np.einsum("nki,ni->nk", turned, normals) < -_BEYOND * np.sum(normals**2, axis=1)[:, None]).any(axis=1)


def _ears(outline: Float64[np.ndarray, "k 3"], normal: Float64[np.ndarray, "3"]) -> Int64[np.ndarray, "t 3"]:
    """Triangles of a polygon by ear clipping in the plane of two axes, turned as its outline; none if it has none."""
    flat = np.delete(outline, int(np.argmax(np.abs(normal))), axis=1)
    found = mapbox_earcut.triangulate_float64(flat, np.array([len(flat)], dtype=np.uint32))
    triangles = found.reshape(-1, 3).astype(np.int64)
    turned = normals(outline[triangles]) @ normal
    triangles[turned < 0.0] = triangles[turned < 0.0][:, ::-1]
    return triangles
