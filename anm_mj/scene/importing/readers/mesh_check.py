"""Checks a mesh file before it is read: whether it is readable, and which features will be missing."""

from __future__ import annotations

import os
import struct
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

from anm_mj.errors import SceneError
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.limits import MAX_MESH_MIB, check_parts, check_size
from anm_mj.utils.read_file import open_regular, parse_json, read_bytes

MESH_SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".dae")
"""Mesh files that can be read."""

_BASIS = ("KHR_texture_basisu", "GOOGLE_texture_basis")
_BASIS_NOTE = (
    "Basis Universal textures cannot be decoded here, so the surfaces of {names} come out plain: take the variant with "
    "JPEG or PNG textures if there is one (the -glb archives of HM3D), or convert a .glb once outside "
    "(`gltf-transform ktxdecompress IN OUT`)."
)
_TRANSFORM_NOTE = "Texture transforms are not applied, so the textures of {names} may come out shifted or scaled."


def check_mesh_file(src: Path, report: ImportReport) -> bool:
    """Accept a file that looks readable, and return whether its textures can be decoded as far as it says.

    Raises:
        SceneError: if the file is missing, of another format, empty, unreadable, or compressed in a way that cannot be
            undone here.
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
        return _check_gltf(src, size, report)
    if src.suffix.lower() == ".dae":
        check_parts(src, _collada_parts(src))
    if src.suffix.lower() == ".obj":
        check_parts(src, _obj_parts(src))
    return True


def damaged(src: Path, reason: object) -> SceneError:
    """The error for a file that is not what its suffix says."""
    line = str(reason).strip().split("\n")[0] or type(reason).__name__
    return SceneError(f"{src} is damaged or no {src.suffix[1:]} file ({line}): export it again.")


def _collada_parts(src: Path) -> int:
    """Meshes that a COLLADA file puts into the scene; nodes may stand in other nodes, each several times.

    Raises:
        SceneError: if the file is no XML, or a node stands in itself.
    """
    try:
        root = ET.fromstring(read_bytes(src, MAX_MESH_MIB))
    except (ET.ParseError, ValueError, OSError, RecursionError) as err:
        raise damaged(src, err) from err
    nodes = {node.get("id"): node for node in root.iter() if node.tag.rpartition("}")[2] == "node"}
    parts: dict[str | None, int] = {}

    def count(element: ET.Element, above: tuple[str, ...]) -> int:
        total = 0
        for inner in element.iter():
            kind, url = inner.tag.rpartition("}")[2], inner.get("url", "").removeprefix("#")
            if kind in ("instance_geometry", "instance_controller"):
                total += 1
            elif kind == "instance_node" and url in nodes:
                if url in above:
                    raise damaged(src, f"node {url!r} stands in itself")
                if url not in parts:
                    parts[url] = count(nodes[url], (*above, url))
                total += parts[url]
        return total

    try:
        return sum(count(scene, ()) for scene in root.iter() if scene.tag.rpartition("}")[2] == "visual_scene")
    except RecursionError:
        raise damaged(src, "its nodes are nested too deeply") from None


def _obj_parts(src: Path) -> int:
    """Changes of the material in an OBJ file."""
    with src.open("rb") as file:
        return sum(line.startswith(b"usemtl") for line in file)


def _check_gltf(src: Path, size: int, report: ImportReport) -> bool:
    """Refuse a glTF whose triangles cannot be decoded; note textures that cannot, and return whether all can."""
    try:
        header = _gltf_header(src, size)
        used = set(header.get("extensionsUsed", []))
        quantised = _quantised(header)
        textures = header.get("textures", [])
        # A texture may name an ordinary image for readers that do not know the extension.
        basis = any("source" not in texture for texture in textures if set(texture.get("extensions", {})) & {*_BASIS})
    except (struct.error, ValueError, TypeError, AttributeError, LookupError) as err:
        raise damaged(src, err) from err
    if "EXT_meshopt_compression" in used:
        raise SceneError(
            f"{src} is meshopt-compressed, which cannot be read: export it without compression "
            "(`gltf-transform copy IN OUT` undoes it)."
        )
    if quantised:
        raise SceneError(
            f"{src} stores its coordinates as normalised integers, which cannot be read: export it with plain numbers "
            "(`gltf-transform dequantize IN OUT`)."
        )
    if basis:
        report.add(_BASIS_NOTE, src.name)
    if "KHR_texture_transform" in used:
        report.add(_TRANSFORM_NOTE, src.name)
    return not basis


def _quantised(header: dict[str, Any]) -> bool:
    """Whether positions or texture coordinates are integers that stand for fractions."""
    accessors = header.get("accessors", [])
    return any(
        accessors[index].get("normalized", False)
        for mesh in header.get("meshes", [])
        for primitive in mesh["primitives"]
        for attribute, index in primitive["attributes"].items()
        if attribute in ("POSITION", "TEXCOORD_0")
    )


def _gltf_header(src: Path, size: int) -> dict[str, Any]:
    """The JSON of a .gltf or .glb (glTF 2.0, section 4.4)."""
    with src.open("rb") as file:
        if src.suffix.lower() == ".glb":
            magic, _, length, json_length, kind = struct.unpack("<4sIII4s", file.read(20))
            if magic != b"glTF" or kind != b"JSON":
                raise ValueError("it does not begin as a .glb does")
            if length > size:
                raise ValueError(f"it ends after {size} of {length} bytes")
            data = file.read(json_length)
        else:
            data = file.read()
    header = parse_json(data)
    if not isinstance(header, dict):
        raise ValueError("its JSON is not an object")
    return header
