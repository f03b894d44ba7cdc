"""Checks a glTF file before it is read: whether all of its triangles and textures can be, and how much there is."""

from __future__ import annotations

import base64
import io
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from PIL import Image

from anm_mj.errors import SceneError
from anm_mj.scene.importing.readers.import_limits import MAX_MESH_MIB, check_parts, check_triangles
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.mesh_facts import MeshFacts, damaged
from anm_mj.scene.importing.readers.texture_file import UNDECODABLE, find_texture
from anm_mj.utils.read_file import open_regular, parse_json, read_bytes

_BASIS = ("KHR_texture_basisu", "GOOGLE_texture_basis")
_BASIS_NOTE = (
    "Basis Universal textures cannot be decoded here, so the surfaces of {names} come out plain: take the variant with "
    "JPEG or PNG textures if there is one (the -glb archives of HM3D), or convert a .glb once outside "
    "(`gltf-transform ktxdecompress IN OUT`)."
)
_TRANSFORM_NOTE = "Texture transforms are not applied, so the textures of {names} may come out shifted or scaled."
_MORPH_NOTE = "Morph targets are not applied: {names} come out as without them."
_SKIN_NOTE = "Skins are not applied: {names} stand as they were made, without their bones."

_DRACO, _MESHOPT, _COPIES = "KHR_draco_mesh_compression", "EXT_meshopt_compression", "EXT_mesh_gpu_instancing"
_TAKEN = (
    *_BASIS,
    _DRACO,
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "EXT_texture_webp",
    "KHR_animation_pointer",
)
_LOOKS = ("KHR_materials_", "EXT_materials_", "ADOBE_materials_", "KHR_lights_", "EXT_lights_", "KHR_xmp")
"""Beginnings of the names of extensions that change how a scene is lit, and no triangle."""

_TRIANGLES, _STRIP, _FAN = 4, 5, 6
"""Modes of primitives (glTF 2.0, section 5.24.4); those below are points and lines."""
_UNSIGNED_SHORT = 5123
_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_NUMBERS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
"""Bytes of a number and numbers of an element of an accessor (section 3.6.2.2)."""
_MAX_STRIDE = 252
_DATA_HEAD = 200
"""What a data URI says of its encoding stands within so many letters."""


def check_gltf(src: Path, size: int, report: ImportReport) -> MeshFacts:
    """Refuse a glTF whose triangles cannot all be read, or are too many; note textures that cannot be decoded.

    Raises:
        SceneError: if it is so, or the file is damaged.
    """
    try:
        header, body = _header(src, size)
        used, required = set(header.get("extensionsUsed", [])), set(header.get("extensionsRequired", []))
        copies = any(_COPIES in node.get("extensions", {}) for node in header.get("nodes", []))
        unread = sorted(name for name in required if name not in _TAKEN and not name.startswith(_LOOKS))
        quantised = _quantised(header)
        textures = header.get("textures", [])
        # A texture may name an ordinary image for readers that do not know the extension.
        basis = any("source" not in texture for texture in textures if set(texture.get("extensions", {})) & {*_BASIS})
        refused = _refused(header)
        parts, triangles = _placed(header)
        morphed = list(_morphed(header))
        _check_buffers(src, header)
        junk = list(_undecodable(src, header, body))
        skinned = [f"node {node.get('name', k)!r}" for k, node in enumerate(header.get("nodes", [])) if "skin" in node]
        transformed = any("KHR_texture_transform" in slot.get("extensions", {}) for slot in _colour_slots(header))
        uneven = any(even_primitive(header, primitive) != primitive for primitive in _primitives(header))
    except (struct.error, ValueError, TypeError, AttributeError, LookupError, OSError) as err:
        raise damaged(src, err) from err
    if _MESHOPT in used | required:
        raise SceneError(
            f"{src} is meshopt-compressed, which cannot be read: export it without compression "
            "(`gltf-transform copy IN OUT` undoes it)."
        )
    if copies:
        raise SceneError(
            f"{src} makes copies of meshes by {_COPIES}, which cannot be read: export it with a node for each copy."
        )
    if unread:
        raise SceneError(f"{src} requires {', '.join(unread)}, which cannot be read: export it without.")
    if quantised:
        raise SceneError(
            f"{src} stores its coordinates as normalised integers, which cannot be read: export it with plain numbers "
            "(`gltf-transform dequantize IN OUT`)."
        )
    if refused:
        raise SceneError(f"{src} holds {refused}.")
    if header.get("meshes") and not parts:
        raise SceneError(
            f"{src} has {len(header['meshes'])} meshes and no scene that places one: export it with the scene that "
            "they stand in."
        )
    check_parts(src, parts)
    check_triangles(src, triangles)
    if basis:
        report.add(_BASIS_NOTE, src.name)
    if transformed:
        report.add(_TRANSFORM_NOTE, src.name)
    for name in morphed:
        report.add(_MORPH_NOTE, f"{name} of {src.name}")
    for name in skinned:
        report.add(_SKIN_NOTE, f"{name} of {src.name}")
    for name in junk:
        report.add(UNDECODABLE, f"{name} of {src.name}")
    return MeshFacts(decodable=not basis and not junk, draco=_DRACO in used | required, uneven=uneven)


def even_gltf(src: Path) -> bytes:
    """A glTF file as the library expects it: all primitives as :func:`even_primitive` writes them.

    Raises:
        ValueError: if it cannot be read.
    """
    content = read_bytes(src, MAX_MESH_MIB)
    header, body = _header(src, len(content))
    for mesh in header["meshes"]:
        mesh["primitives"] = [even_primitive(header, primitive) for primitive in mesh["primitives"]]
    header.setdefault("materials", []).append({})
    text = json.dumps(header).encode()
    if not body:
        return text
    text += b" " * (-len(text) % 4)
    rest = content[body - 8 :]
    return struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON") + text + rest


def even_primitive(header: dict[str, Any], primitive: dict[str, Any]) -> dict[str, Any]:
    """A primitive with what the library takes from elsewhere than the format says, where it looks.

    It reads the first texture coordinates, whichever the material asks for, and cuts off colours of 16 bits unless
    there is a material; the default one stands behind all others.
    """
    even = {**primitive, "attributes": {**primitive["attributes"]}}
    named = even["attributes"]
    if "material" not in primitive:
        if "COLOR_0" in named and _entry(header, "accessors", named["COLOR_0"])["componentType"] == _UNSIGNED_SHORT:
            even["material"] = len(header.get("materials", []))
    else:
        slot = _colour_slot(_entry(header, "materials", primitive["material"])) or {}
        wanted = slot.get("extensions", {}).get("KHR_texture_transform", {}).get("texCoord", slot.get("texCoord", 0))
        if wanted != 0 and f"TEXCOORD_{wanted}" in named:
            named["TEXCOORD_0"] = named[f"TEXCOORD_{wanted}"]
    return even


def _header(src: Path, size: int) -> tuple[dict[str, Any], int]:
    """The JSON of a .gltf or .glb, and where the buffer of a .glb begins (glTF 2.0, section 4.4)."""
    body = 0
    with open_regular(src) as file:
        if src.suffix.lower() == ".glb":
            magic, _, length, json_length, kind = struct.unpack("<4sIII4s", file.read(20))
            if magic != b"glTF" or kind != b"JSON":
                raise ValueError("it does not begin as a .glb does")
            if length > size:
                raise ValueError(f"it ends after {size} of {length} bytes")
            data = file.read(json_length)
            body = 20 + json_length + 8
        else:
            data = file.read()
    header = parse_json(data)
    if not isinstance(header, dict):
        raise ValueError("its JSON is not an object")
    return header, body


def _entry(header: dict[str, Any], kind: str, index: Any) -> dict[str, Any]:
    """An entry of one of the lists of a file, which name one another by index."""
    entries = header.get(kind, [])
    if type(index) is not int or not 0 <= index < len(entries):
        raise ValueError(f"it names entry {index!r} of its {len(entries)} {kind}")
    return entries[index]


def _primitives(header: dict[str, Any]) -> Iterator[dict[str, Any]]:
    return (primitive for mesh in header.get("meshes", []) for primitive in mesh["primitives"])


def _accessors(header: dict[str, Any], primitive: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """The accessors of a primitive that are read, by what they are for."""
    named = {**primitive["attributes"], "indices": primitive.get("indices")}
    return {
        name: _entry(header, "accessors", named[name])
        for name in ("POSITION", "TEXCOORD_0", "COLOR_0", "indices")
        if named.get(name) is not None
    }


def _check_place(header: dict[str, Any], accessor: dict[str, Any]) -> None:
    """Refuse an accessor whose numbers lie nowhere, or over one another."""
    view = _entry(header, "bufferViews", accessor["bufferView"]) if "bufferView" in accessor else {}
    for value in (accessor["count"], accessor.get("byteOffset", 0), view.get("byteOffset", 0)):
        if type(value) is not int or value < 0:
            raise ValueError(f"an accessor has a count or an offset of {value!r}")
    element = _BYTES[accessor["componentType"]] * _NUMBERS[accessor["type"]]
    if not element <= view.get("byteStride", element) <= _MAX_STRIDE:
        raise ValueError(f"elements of {element} bytes are stored every {view['byteStride']!r} bytes")


def _check_buffers(src: Path, header: dict[str, Any]) -> None:
    """Refuse a file whose numbers lie in a file that is not there, or too short, or in text that is not base64."""
    for buffer in header.get("buffers", []):
        uri, length = str(buffer.get("uri", "data:;base64,")), buffer["byteLength"]
        if uri.startswith("data:"):
            if ";base64," not in uri[:_DATA_HEAD]:
                raise SceneError(f"{src} holds a buffer that is not base64 ({uri[:40]!r}...): export it again.")
            continue
        path = find_texture(uri, src.absolute().parent)
        if path is None:
            raise SceneError(f"{src} names the buffer {uri[:80]!r}, which is not beside it: copy it there.")
        if path.stat().st_size < length:
            raise SceneError(
                f"{src} names the buffer {path.name}, which ends after {path.stat().st_size} of {length} bytes: copy "
                "it again."
            )


def _quantised(header: dict[str, Any]) -> bool:
    """Whether positions or texture coordinates are integers that stand for fractions."""
    return any(
        accessor.get("normalized", False)
        for primitive in _primitives(header)
        for name, accessor in _accessors(header, primitive).items()
        if name in ("POSITION", "TEXCOORD_0")
    )


def _refused(header: dict[str, Any]) -> str:
    """What a file holds that the library would take for something else or leave out, and what to do; else empty."""
    for primitive in _primitives(header):
        mode = primitive.get("mode", _TRIANGLES)
        if mode == _FAN:
            return "a triangle fan, which cannot be read: export it with plain triangles"
        if type(mode) is not int or not 0 <= mode <= _FAN:
            raise ValueError(f"a primitive has the mode {mode!r}, which glTF does not know")
        accessors = _accessors(header, primitive).values()
        for accessor in accessors:
            _check_place(header, accessor)
        if any("sparse" in accessor for accessor in accessors):
            return "a sparse accessor, which cannot be read: export it with plain arrays"
        if "material" in primitive:
            _entry(header, "materials", primitive["material"])
    return ""


def _placed(header: dict[str, Any]) -> tuple[int, int]:
    """Primitives and triangles that the nodes of the scene place, each as often as they do."""
    if not header.get("scenes"):
        return 0, 0
    sizes = [
        (len(mesh["primitives"]), sum(_triangles(header, primitive) for primitive in mesh["primitives"]))
        for mesh in header.get("meshes", [])
    ]
    waiting = list(dict.fromkeys(_entry(header, "scenes", header.get("scene", 0)).get("nodes", [])))
    seen: set[int] = set()
    parts, triangles = 0, 0
    while waiting:
        index = waiting.pop()
        if index in seen:
            # The library would place it once.
            raise ValueError(f"node {index!r} stands in several others, or in itself")
        seen.add(index)
        node = _entry(header, "nodes", index)
        waiting += node.get("children", [])
        if "mesh" in node:
            _entry(header, "meshes", node["mesh"])
            parts, triangles = parts + sizes[node["mesh"]][0], triangles + sizes[node["mesh"]][1]
    return parts, triangles


def _triangles(header: dict[str, Any], primitive: dict[str, Any]) -> int:
    mode, accessors = primitive.get("mode", _TRIANGLES), _accessors(header, primitive)
    corners = accessors.get("indices", accessors.get("POSITION", {})).get("count", 0)
    return corners // 3 if mode == _TRIANGLES else max(0, corners - 2) if mode == _STRIP else 0


def _morphed(header: dict[str, Any]) -> Iterator[str]:
    """Names of the meshes whose vertices default weights move; those that only an animation moves stand still."""
    meshes = header.get("meshes", [])
    placed = ((node["mesh"], node) for node in header.get("nodes", []) if "mesh" in node)
    for index, holder in [*enumerate(meshes), *placed]:
        mesh = _entry(header, "meshes", index)
        if any(holder.get("weights", [])) and any("targets" in primitive for primitive in mesh["primitives"]):
            yield f"mesh {mesh.get('name', index)!r}"


def _undecodable(src: Path, header: dict[str, Any], body: int) -> Iterator[str]:
    """Names of the pictures of colours that the library would leave out without a word.

    What is missing is noted when it is looked for; what is there is opened here, and not decoded.
    """
    buffers: dict[str, bytes] = {}
    textures = {slot["index"]: _entry(header, "textures", slot["index"]) for slot in _colour_slots(header)}
    yield from (
        f"texture {index}"
        for index, own in textures.items()
        if _source(own) is None and not {*own.get("extensions", {})} & {*_BASIS}
    )
    for index in dict.fromkeys(source for own in textures.values() if (source := _source(own)) is not None):
        image = _entry(header, "images", index)
        data = _image_bytes(src, header, image, body, buffers)
        try:
            if data is not None:
                Image.open(io.BytesIO(data)).close()
        # Pillow raises whatever a decoder stumbles over.
        except Exception:
            uri = str(image.get("uri", "data:"))
            yield str(image.get("name") or (f"image {index}" if uri.startswith("data:") else uri))


def _colour_slots(header: dict[str, Any]) -> list[dict[str, Any]]:
    """How each material that takes its colour from a texture names it."""
    return [slot for material in header.get("materials", []) if (slot := _colour_slot(material)) is not None]


def _colour_slot(material: dict[str, Any]) -> dict[str, Any] | None:
    """How a material names the texture of its colour; None without one."""
    gloss = material.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness", {})
    return material.get("pbrMetallicRoughness", {}).get("baseColorTexture", gloss.get("diffuseTexture"))


def _source(texture: dict[str, Any]) -> int | None:
    return texture.get("extensions", {}).get("EXT_texture_webp", texture).get("source")


def _image_bytes(
    src: Path, header: dict[str, Any], image: dict[str, Any], body: int, buffers: dict[str, bytes]
) -> bytes | None:
    """An image as it is stored; None if its file is missing. ``buffers`` remembers what was unpacked."""
    if "bufferView" not in image:
        return _uri_bytes(src, str(image["uri"]), buffers)
    view = _entry(header, "bufferViews", image["bufferView"])
    uri = _entry(header, "buffers", view["buffer"]).get("uri")
    start, length = view.get("byteOffset", 0), view["byteLength"]
    if uri is not None:
        data = _uri_bytes(src, str(uri), buffers)
        return None if data is None else data[start : start + length]
    with open_regular(src) as file:
        file.seek(body + start)
        return file.read(length)


def _uri_bytes(src: Path, uri: str, buffers: dict[str, bytes]) -> bytes | None:
    """What a URI leads to: the data that it is, or the content of a file that lies beside the mesh."""
    if uri not in buffers:
        if uri.startswith("data:"):
            buffers[uri] = base64.b64decode(uri.partition(",")[2])
        else:
            path = find_texture(uri, src.absolute().parent)
            if path is None:
                return None
            with open_regular(path) as file:
                buffers[uri] = file.read()
    return buffers[uri]
