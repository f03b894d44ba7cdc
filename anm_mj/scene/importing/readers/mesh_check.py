"""Checks a mesh file before it is read: whether it is readable, and which features will be missing."""

from __future__ import annotations

import json
import os
import struct
from pathlib import Path
from typing import Any

from anm_mj.errors import SceneError
from anm_mj.scene.importing.readers.import_report import ImportReport

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
        with src.open("rb") as file:
            file.read(1)
    except OSError as err:
        raise SceneError(f"{src} cannot be read ({err.strerror}): check its permissions.") from err
    if not size:
        raise SceneError(f"{src} is empty (0 bytes): copy or export it again.")
    if src.suffix.lower() in (".glb", ".gltf"):
        return _check_gltf(src, size, report)
    return True


def damaged(src: Path, reason: object) -> SceneError:
    """The error for a file that is not what its suffix says."""
    line = str(reason).strip().split("\n")[0] or type(reason).__name__
    return SceneError(f"{src} is damaged or no {src.suffix[1:]} file ({line}): export it again.")


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
    header = json.loads(data)
    if not isinstance(header, dict):
        raise ValueError("its JSON is not an object")
    return header
