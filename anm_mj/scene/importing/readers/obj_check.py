"""Checks an OBJ file before it is read, and writes its lines as the library expects them."""

import re
from collections.abc import Collection
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from anm_mj.errors import SceneError
from anm_mj.scene.importing.readers.import_limits import MAX_MESH_MIB, check_parts, check_triangles
from anm_mj.scene.importing.readers.import_report import LEFT_OUT, ImportReport, MeshFacts
from anm_mj.scene.importing.readers.obj_material import Materials, check_materials, is_utf8
from anm_mj.scene.importing.readers.polygons import MAX_CORNERS, cut_polygons
from anm_mj.utils.read_file import open_regular, read_bytes

_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_NOT_READ = (b"surf ", b"fo ", b"bzp ", b"bsp ", b"call ")
"""Keywords of free-form surfaces, of obsolete faces, and of other files."""
_LIBRARY = re.compile(rb"(?m)^mtllib +(.*)$")
_VERTEX_ZERO = re.compile(rb"\s0+(?:/|\s|$)")


def check_obj(src: Path, report: ImportReport) -> MeshFacts:
    """Look at every line of an OBJ file, and note the surfaces and materials that are not read. Raises SceneError if it
    has too many materials or triangles, a vertex has less than three numbers, or a face names vertex 0.
    """
    libraries: list[bytes] = []
    materials: dict[bytes, set[bool]] = {}
    """Whether its faces have texture coordinates, by material; a value for each kind of face that it has."""
    mapped: set[bool] = set()
    triangles, plain, uneven = 0, True, False
    with open_regular(src) as file:
        for number, line in enumerate(file, 1):
            # trimesh finds a line by what stands first in it, with a space behind.
            if line[0] in b" \t" or b"\t" in line or (number == 1 and line.startswith(_BYTE_ORDER_MARK)):
                uneven = True
                line = line.removeprefix(_BYTE_ORDER_MARK).strip().replace(b"\t", b" ")
            if not line.isascii():
                plain = plain and is_utf8(line)
            if line.startswith(b"usemtl"):
                mapped = materials.setdefault(line[6:].strip(), set())
            elif line.startswith(_NOT_READ):
                report.add(LEFT_OUT, f"{line.split()[0].decode()!r} in line {number} of {src.name}")
            elif line.startswith(b"v ") and len(line.split()) < 4 and not line.rstrip().endswith(b"\\"):
                raise SceneError(
                    f"{src}, line {number}: a vertex has {len(line.split()) - 1} numbers instead of 3: export it again."
                )
            elif line.startswith(b"f "):
                corners = len(line.split()) - 1
                if corners > MAX_CORNERS:
                    raise SceneError(
                        f"{src}, line {number}: a face has {corners} corners, but faces end at {MAX_CORNERS}: export "
                        "it with triangles."
                    )
                if b" 0" in line and _VERTEX_ZERO.search(line):
                    raise SceneError(
                        f"{src}, line {number}: a face names vertex 0, but OBJ counts from 1: export it again."
                    )
                triangles += max(1, corners - 2)
                mapped.add(_is_mapped(line))
                uneven = uneven or not _is_plain_face(line)
            elif line.startswith(b"mtllib "):
                uneven = uneven or bool(libraries)
                libraries.append(line[7:].strip())
            elif b"mtllib" in line:
                # The library takes the word in a comment for the line.
                uneven = True
    check_parts(src, len(materials))
    check_triangles(src, triangles)
    used = [name for name, kinds in materials.items() if name and kinds]
    try:
        found = check_materials(src, used, libraries, plain, report)
    # The library guesses encodings by a package that may be missing, and by names that Python may not know.
    except (OSError, ValueError, LookupError, ImportError) as err:
        report.add(LEFT_OUT, f"the materials of {src.name} ({err})")
        found = Materials()
    unmapped = frozenset(name for name in used if len(materials[name]) == 2 and name in found.pictured)
    uneven = uneven or bool(unmapped) or (found.latin and not plain)
    return MeshFacts(uneven=uneven, unmapped=unmapped, latin=found.latin)


def even_text(src: Path, unmapped: Collection[bytes] = (), latin: bool = False) -> bytes:
    """An OBJ file as the library expects it.

    Without byte order mark, tabs, spaces before a line, lines that go on in the next, and comments about material
    files; with one line of these, vertices counted from 1, and polygons that a fan covers: the library counts negative
    indices from the end of the file, where OBJ counts them from the line that they stand in, and cuts every polygon
    into a fan about its first corner, which reaches beyond one that is not convex. Faces of the materials ``unmapped``
    all have texture coordinates, since the library drops those of a material if one face has none, or takes normals for
    them. With ``latin``, a text in another encoding than UTF-8 is Latin-1. Raises ValueError if it cannot be read.
    """
    text = read_bytes(src, MAX_MESH_MIB).removeprefix(_BYTE_ORDER_MARK).replace(b"\t", b" ")
    text = text.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    text = re.sub(rb"(?m)^#.*mtllib.*$", b"#", re.sub(rb"(?m)^ +", b"", text))
    libraries = list(dict.fromkeys(name.strip() for name in _LIBRARY.findall(text)))
    if len(libraries) > 1:
        text = b"mtllib " + b" ".join(libraries) + b"\n" + _LIBRARY.sub(b"", text)
    text = _with_plain_faces(text, unmapped)
    return text.decode("latin-1").encode() if latin and not is_utf8(text) else text


def _is_mapped(line: bytes) -> bool:
    """Whether the corners of a face have texture coordinates, as in 1/1 and 1/1/1."""
    corners = line.partition(b"#")[0]
    return b"/" in corners and b"//" not in corners


def _is_plain_face(line: bytes) -> bool:
    """Whether a face is a triangle that names its vertices from 1 and has no comment behind it."""
    return b"-" not in line and b"#" not in line and len(line.split()) <= 4


def _with_plain_faces(text: bytes, unmapped: Collection[bytes]) -> bytes:
    lines = text.split(b"\n")
    if unmapped:
        _map_faces(lines, unmapped)
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


def _map_faces(lines: list[bytes], materials: Collection[bytes]) -> None:
    """Give one more entry of texture coordinates to the corners of some materials' faces that have none."""
    entries = [len(line.split()) for line in lines if line.startswith(b"vt ")]
    is_own = False
    for number, line in enumerate(lines):
        if line.startswith(b"usemtl"):
            is_own = line[6:].strip() in materials
        elif is_own and line.startswith(b"f ") and not _is_mapped(line):
            corners = line.partition(b"#")[0].split()[1:]
            lines[number] = b"f " + b" ".join(_mapped(corner, len(entries) + 1) for corner in corners)
    # With as many numbers as the others.
    lines.append(b"vt" + b" 0" * (max(entries, default=3) - 1))


def _mapped(corner: bytes, entry: int) -> bytes:
    """A corner such as 1 or 1//1 with the texture coordinates ``entry`` if it has none."""
    vertex, *others = corner.split(b"/")
    if others[:1] in ([], [b""]):
        others[:1] = [b"%d" % entry]
    return b"/".join([vertex, *others])


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
    for own, triangles in cut_polygons(points, index):
        lines[numbers[own]] = b"\n".join(
            b"f " + b" ".join(corners[own][corner] for corner in triangle) for triangle in triangles
        )
