"""Checks an OBJ file before it is read, and writes its lines as the library expects them."""

from __future__ import annotations

import re
from pathlib import Path

from anm_mj.errors import SceneError
from anm_mj.scene.importing.readers.import_limits import MAX_MESH_MIB, check_parts
from anm_mj.scene.importing.readers.import_report import LEFT_OUT, ImportReport
from anm_mj.scene.importing.readers.mesh_facts import MeshFacts
from anm_mj.scene.importing.readers.obj_faces import is_plain_face, with_plain_faces
from anm_mj.utils.read_file import open_regular, read_bytes

_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_NOT_READ = (b"surf ", b"fo ", b"bzp ", b"bsp ", b"call ")
"""Words of surfaces in curves, of faces of former versions, and of other files."""
_LIBRARY = re.compile(rb"(?m)^mtllib +(.*)$")
_VERTEX_ZERO = re.compile(rb"\s0+(?:/|\s|$)")


def check_obj(src: Path, report: ImportReport) -> MeshFacts:
    """Look at every line of an OBJ file, and note the surfaces that are not read.

    Raises:
        SceneError: if it changes its material too often, a vertex has less than three numbers, or a face names vertex
            0.
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
                if b" 0" in line and _VERTEX_ZERO.search(line):
                    raise SceneError(
                        f"{src}, line {number}: a face names vertex 0, but OBJ counts from 1: export it again."
                    )
                uneven = uneven or not is_plain_face(line)
            elif line.startswith(b"mtllib "):
                uneven, libraries = uneven or libraries > 0, libraries + 1
    check_parts(src, parts)
    return MeshFacts(uneven=uneven)


def even_text(src: Path) -> bytes:
    """An OBJ file as the library expects it.

    Without byte order mark, tabs, spaces before a line, and lines that go on in the next; with one line of material
    files, and faces as :func:`anm_mj.scene.importing.readers.obj_faces.with_plain_faces` writes them.

    Raises:
        ValueError: if it cannot be read.
    """
    text = read_bytes(src, MAX_MESH_MIB).removeprefix(_BYTE_ORDER_MARK).replace(b"\t", b" ")
    text = text.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    text = re.sub(rb"(?m)^ +", b"", text)
    libraries = list(dict.fromkeys(name.strip() for name in _LIBRARY.findall(text)))
    if len(libraries) > 1:
        text = b"mtllib " + b" ".join(libraries) + b"\n" + _LIBRARY.sub(b"", text)
    return with_plain_faces(text)
