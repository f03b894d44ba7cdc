"""What a mesh file says about itself before it is read: whether it can be, and what will be missing."""

from __future__ import annotations

import importlib.util
import json
import logging
import os
import re
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from anm_mj.errors import SceneError

_logger = logging.getLogger(__name__)

KINDS = (".glb", ".gltf", ".obj", ".ply")
"""File kinds that can be read."""


def check_source(src: Path) -> None:
    """Accept a file that looks readable; warn of textures that will be missing.

    Raises:
        SceneError: if the file is missing, of another kind, empty, unreadable, or compressed in a way that cannot be
            undone here.
    """
    kinds = ", ".join(KINDS)
    if not os.path.exists(src):  # Unlike Path.exists, never an error.
        raise SceneError(f"{src} does not exist: give the path of a mesh file ({kinds}).")
    if not os.path.isfile(src) or src.suffix.lower() not in KINDS:
        raise SceneError(f"{src} is not of a kind that can be imported: give a mesh file ({kinds}).")
    try:
        data = src.read_bytes()
    except OSError as err:
        raise SceneError(f"{src} cannot be read ({err.strerror}): check its permissions.") from err
    if not data:
        raise SceneError(f"{src} is empty (0 bytes): copy or export it again.")
    if src.suffix.lower() in (".glb", ".gltf"):
        _check_gltf(src, data)
    elif src.suffix.lower() == ".obj":
        _warn_of_missing(src, _obj_textures(src, data))


def damaged(src: Path, reason: object) -> SceneError:
    """The error for a file that is not what its suffix says."""
    line = str(reason).strip().split("\n")[0] or type(reason).__name__
    return SceneError(f"{src} is damaged or no {src.suffix[1:]} file ({line}): export it again.")


def _check_gltf(src: Path, data: bytes) -> None:
    """Refuse a glTF whose triangles cannot be decoded; warn of textures that cannot."""
    try:
        header = _gltf_header(src, data)
        used = set(header.get("extensionsUsed", []))
        uris = [image.get("uri", "data:") for image in header.get("images", [])]
        files = [src.parent / unquote(uri) for uri in uris if not uri.startswith("data:")]
    except (struct.error, ValueError, TypeError, AttributeError) as err:
        raise damaged(src, err) from err
    if "KHR_draco_mesh_compression" in used and importlib.util.find_spec("DracoPy") is None:
        raise SceneError(f"{src} is Draco-compressed: `pip install DracoPy`, or export it without compression.")
    if "EXT_meshopt_compression" in used:
        raise SceneError(f"{src} is meshopt-compressed, which cannot be read: export it without compression.")
    if used & {"KHR_texture_basisu", "GOOGLE_texture_basis"}:
        _logger.warning(
            "%s holds Basis Universal textures, which cannot be decoded here: its surfaces come out plain; "
            "use the variant with JPEG or PNG textures",
            src,
        )
    _warn_of_missing(src, files)


def _gltf_header(src: Path, data: bytes) -> dict[str, Any]:
    """The JSON of a .gltf or .glb (glTF 2.0, section 4.4)."""
    if src.suffix.lower() == ".glb":
        magic, _, length, json_length, kind = struct.unpack_from("<4sIII4s", data)
        if magic != b"glTF" or kind != b"JSON":
            raise ValueError("it does not begin as a .glb does")
        if length > len(data):
            raise ValueError(f"it ends after {len(data)} of {length} bytes")
        data = data[20 : 20 + json_length]
    header = json.loads(data)
    if not isinstance(header, dict):
        raise ValueError("its JSON is not an object")
    return header


def _obj_textures(src: Path, data: bytes) -> list[Path]:
    """Files that an .obj's materials refer to: the material libraries, and the colour textures in those there are."""
    files = []
    for name in re.findall(rb"^mtllib[ \t]+(.+?)[ \t\r]*$", data, re.MULTILINE):
        library = src.parent / name.decode(errors="replace")
        files.append(library)
        if library.is_file():
            textures = re.findall(
                r"^\s*map_Kd\s+(?:-\S+\s+\S+\s+)*(.+?)\s*$", library.read_text(errors="replace"), re.M
            )
            files += [src.parent / texture for texture in textures]
    return files


def _warn_of_missing(src: Path, files: list[Path]) -> None:
    """Name the files that are not there."""
    missing = sorted({file.name for file in files if not file.is_file()})
    if missing:
        _logger.warning(
            "%s refers to %d files that are not there (%s): surfaces that need them come out plain",
            src,
            len(missing),
            ", ".join(missing[:5]) + (", ..." if len(missing) > 5 else ""),
        )
