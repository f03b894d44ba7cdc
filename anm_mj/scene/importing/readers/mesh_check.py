"""Checks a mesh file before it is read: whether it is readable, and which features will be missing."""

import os
from pathlib import Path

from anm_mj.errors import SceneError
from anm_mj.scene.importing.readers.collada_check import check_collada
from anm_mj.scene.importing.readers.gltf_check import check_gltf
from anm_mj.scene.importing.readers.import_limits import check_size, check_triangles
from anm_mj.scene.importing.readers.import_report import ImportReport, MeshFacts, some
from anm_mj.scene.importing.readers.obj_check import check_obj
from anm_mj.scene.importing.readers.ply_file import CORNERS, PlyElement, ply_header
from anm_mj.utils.read_file import open_regular

MESH_SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".dae")

_HEAD_BYTES = 65536
"""The header of a PLY file ends, and the first triangle of an ASCII STL file begins, within this many bytes."""
_STL_HEAD, _STL_TRIANGLE = 84, 50
"""Bytes of a binary STL file before its triangles, and of each."""


def check_mesh_file(src: Path, report: ImportReport) -> MeshFacts:
    """Accept a file that looks readable, and return what it says of itself. Raises SceneError if the file is missing,
    of another format, empty, unreadable, too large, or stored in a way that cannot be read here.
    """
    suffixes = ", ".join(MESH_SUFFIXES)
    if not os.path.exists(src):  # Unlike Path.exists, never an error.
        raise SceneError(f"{src} does not exist: give the path of a mesh file ({suffixes}).")
    if not os.path.isfile(src) or src.suffix.lower() not in MESH_SUFFIXES:
        raise SceneError(f"{src} is in no format that can be imported: give a mesh file ({suffixes}).")
    try:
        size = os.path.getsize(src)
        open_regular(src).close()
    except OSError as err:
        raise SceneError(f"{src} cannot be read ({err.strerror}): check its permissions.") from err
    if not size:
        raise SceneError(f"{src} is empty (0 bytes): copy or export it again.")
    check_size(src, size)
    suffix = src.suffix.lower()
    if suffix in (".glb", ".gltf"):
        return check_gltf(src, size, report)
    if suffix in (".dae", ".obj"):
        return (check_collada if suffix == ".dae" else check_obj)(src, report)
    if suffix == ".ply":
        _check_ply(src)
    elif suffix == ".stl":
        _check_stl(src, size)
    return MeshFacts()


def _check_stl(src: Path, size: int) -> None:
    """Refuse an STL file of another length than it states, which the library takes for one without triangles."""
    with open_regular(src) as file:
        head = file.read(_HEAD_BYTES)
        stated = int.from_bytes(head[_STL_HEAD - 4 : _STL_HEAD], "little")
        # The header of a binary file may hold the word, too.
        if b"facet" in head.lower() and size != _STL_HEAD + stated * _STL_TRIANGLE:
            file.seek(max(0, size - _HEAD_BYTES))
            if b"endsolid" not in file.read().lower():
                raise SceneError(
                    f"{src} ends before its last triangle ('endsolid' is missing): copy or export it again."
                )
            return
    if size < _STL_HEAD:
        raise SceneError(f"{src} is damaged or no stl file ({size} bytes): export it again.")
    if size != _STL_HEAD + stated * _STL_TRIANGLE:
        raise SceneError(
            f"{src} states {stated} triangles, which take {_STL_HEAD + stated * _STL_TRIANGLE} bytes, and has {size}: "
            "copy or export it again."
        )
    check_triangles(src, stated)


def _check_ply(src: Path) -> None:
    """Refuse a PLY file whose faces name their vertices by a word that nobody knows, or that has too few in a row, too
    many faces, or more pictures than the library tells apart.
    """
    with open_regular(src) as file:
        head = file.read(_HEAD_BYTES)
        header = ply_header(head)
        check_triangles(src, sum(own.stated or 0 for own in header.elements if own.name == "face"))
        if any(line.split()[:2] == ["format", "ascii"] for line in header.lines):
            rest = head.partition(b"end_header")[2] + file.read()
            _check_ply_rows(src, header.elements, rest.decode("latin-1").splitlines()[1:])
    if header.element("tristrips") is not None:
        raise SceneError(f"{src} has strips of triangles, which cannot be read: export it with faces.")
    if len(header.pictures) > 1:
        raise SceneError(
            f"{src} names {len(header.pictures)} pictures ({some(header.pictures, 3)}), but not which of its faces has "
            "which: export it as .glb or .obj."
        )
    faces = (element for element in header.elements if element.name == "face")
    lists = [words[-1] for face in faces for words in face.properties if words[:1] == ["list"]]
    if lists and not {*lists} & {*CORNERS}:
        raise SceneError(
            f"{src} has faces with {', '.join(lists)}, but none with {' or '.join(CORNERS)}: export it again."
        )


def _check_ply_rows(src: Path, elements: list[PlyElement], rows: list[str]) -> None:
    """Refuse an ASCII PLY file with fewer rows than it states, or with faces of fewer corners than a triangle."""
    at = 0
    for element in elements:
        name, stated, properties = element.name, element.stated, element.properties
        if stated is None:
            continue
        if len(rows) < at + stated:
            raise SceneError(
                f"{src} states {stated} rows of {name} and holds {max(0, len(rows) - at)}: copy or export it again."
            )
        for row in range(at, at + stated) if name == "face" else ():
            if not _is_face(rows[row].split(), properties):
                raise SceneError(
                    f"{src} has a face that is none ({rows[row][:40]!r}, row {row - at + 1} of its faces): a face has "
                    "three corners at least, and as many as it states; export it again."
                )
        at += stated


def _is_face(row: list[str], properties: list[list[str]]) -> bool:
    """Whether a row holds what the properties of its element ask for, and three corners or more."""
    at = 0
    for words in properties:
        number = 1
        if words[:1] == ["list"]:
            if at >= len(row) or not row[at].isdecimal():
                return False
            number, at = int(row[at]), at + 1
            if words[-1] in CORNERS and number < 3:
                return False
        at += number
    return at == len(row)
