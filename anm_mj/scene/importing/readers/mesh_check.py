"""Checks a mesh file before it is read: whether it is readable, and which features will be missing."""

from __future__ import annotations

import os
from pathlib import Path

from anm_mj.errors import SceneError
from anm_mj.scene.importing.readers.collada_check import check_collada
from anm_mj.scene.importing.readers.gltf_check import check_gltf
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.limits import check_size
from anm_mj.scene.importing.readers.mesh_facts import MeshFacts
from anm_mj.scene.importing.readers.obj_check import check_obj
from anm_mj.utils.read_file import open_regular

MESH_SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".dae")
"""Mesh files that can be read."""

_HEAD_BYTES = 65536
"""The header of a PLY file ends within so many bytes."""
_PLY_CORNERS = ("vertex_indices", "vertex_index")


def check_mesh_file(src: Path, report: ImportReport) -> MeshFacts:
    """Accept a file that looks readable, and return what it says of itself.

    Raises:
        SceneError: if the file is missing, of another format, empty, unreadable, too large, or stored in a way that
            cannot be read here.
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
    if src.suffix.lower() in (".glb", ".gltf"):
        return check_gltf(src, size, report)
    if src.suffix.lower() == ".dae":
        return check_collada(src, report)
    if src.suffix.lower() == ".obj":
        return check_obj(src, report)
    if src.suffix.lower() == ".ply":
        _check_ply(src)
    return MeshFacts()


def _check_ply(src: Path) -> None:
    """Refuse a PLY file whose faces name their vertices by a word that nobody knows."""
    with open_regular(src) as file:
        lines = file.read(_HEAD_BYTES).partition(b"end_header")[0].decode("latin-1").splitlines()
    element, lists = "", []
    for words in (line.split() for line in lines):
        if words[:1] == ["element"]:
            element = " ".join(words[1:2])
            if element == "tristrips":
                raise SceneError(f"{src} has strips of triangles, which cannot be read: export it with faces.")
        elif words[:2] == ["property", "list"] and element == "face":
            lists.append(words[-1])
    if lists and not {*lists} & {*_PLY_CORNERS}:
        raise SceneError(
            f"{src} has faces with {', '.join(lists)}, but none with {' or '.join(_PLY_CORNERS)}: export it again."
        )
