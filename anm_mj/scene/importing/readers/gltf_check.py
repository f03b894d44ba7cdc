"""Checks a glTF file before it is read: whether all of its triangles and textures can be, and how much there is."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from anm_mj.errors import SceneError
from anm_mj.scene.importing.readers.gltf_file import GltfFile, colour_slot, open_gltf
from anm_mj.scene.importing.readers.import_limits import MAX_TRIANGLES, check_parts, check_triangles
from anm_mj.scene.importing.readers.import_report import ImportReport, MeshFacts, damaged
from anm_mj.scene.importing.readers.texture_file import TRANSFORMED, UNDECODABLE, find_texture, is_decodable

_BASIS = ("KHR_texture_basisu", "GOOGLE_texture_basis")
_BASIS_NOTE = (
    "Basis Universal textures cannot be decoded here, so the surfaces of {names} come out plain: take the variant with "
    "JPEG or PNG textures if there is one (the -glb archives of HM3D), or convert a .glb once outside "
    "(`gltf-transform ktxdecompress IN OUT`)."
)
_MORPH_NOTE = "Morph targets are not applied: {names} come out as without them."
_SKIN_NOTE = "Skins are not applied: {names} stand as they were made, without their bones."

_DRACO, _MESHOPT, _COPIES = "KHR_draco_mesh_compression", "EXT_meshopt_compression", "EXT_mesh_gpu_instancing"
_TRANSFORM = "KHR_texture_transform"
_TAKEN = (*_BASIS, _DRACO, _TRANSFORM, "KHR_mesh_quantization", "EXT_texture_webp", "KHR_animation_pointer")
_LOOKS = ("KHR_materials_", "EXT_materials_", "ADOBE_materials_", "KHR_lights_", "EXT_lights_", "KHR_xmp")
"""Beginnings of the names of extensions that change how a scene is lit, and no triangle."""

_TRIANGLES, _STRIP, _FAN = 4, 5, 6
"""Modes of primitives (glTF 2.0, section 5.24.4); those below are points and lines."""
_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_NUMBERS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
"""Bytes of a number and numbers of an element of an accessor (section 3.6.2.2)."""
_MAX_STRIDE = 252
_DATA_HEAD = 200
"""A data URI states its encoding within this many letters."""


def check_gltf(src: Path, size: int, report: ImportReport) -> MeshFacts:
    """Refuse a glTF whose triangles cannot all be read, or are too many; note textures that cannot be decoded. Raises
    SceneError if it is so, or the file is damaged.
    """
    try:
        gltf = open_gltf(src, size)
        meshes = gltf.listed("meshes")
        used, required = set(gltf.listed("extensionsUsed")), set(gltf.listed("extensionsRequired"))
        copies = any(_COPIES in node.get("extensions", {}) for node in gltf.listed("nodes"))
        unread = sorted(name for name in required if name not in _TAKEN and not name.startswith(_LOOKS))
        quantised = _quantised(gltf)
        textures = gltf.listed("textures")
        # A texture may name an ordinary image for readers that do not know the extension.
        basis = any("source" not in texture for texture in textures if set(texture.get("extensions", {})) & {*_BASIS})
        refused = _refused(gltf)
        parts, triangles = _placed(gltf)
        morphed = list(_morphed(gltf))
        _check_buffers(gltf)
        junk = list(_undecodable(gltf))
        skinned = [f"node {node.get('name', k)!r}" for k, node in enumerate(gltf.listed("nodes")) if "skin" in node]
        transformed = any(_TRANSFORM in slot.get("extensions", {}) for slot in _colour_slots(gltf))
        # The library leaves out a node with a camera, and takes what stands in it for damage.
        uneven = any("camera" in node and ("mesh" in node or node.get("children")) for node in gltf.listed("nodes"))
        uneven = uneven or any(gltf.even_primitive(primitive) != primitive for primitive in gltf.primitives())
    except (struct.error, ValueError, TypeError, AttributeError, LookupError, OSError) as err:
        raise damaged(src, err) from err
    refusals = (
        (
            _MESHOPT in used | required,
            "is meshopt-compressed, which cannot be read: export it without compression (`gltf-transform copy IN OUT` "
            "undoes it)",
        ),
        (copies, f"makes copies of meshes by {_COPIES}, which cannot be read: export it with a node for each copy"),
        (unread, f"requires {', '.join(unread)}, which cannot be read: export it without"),
        (
            quantised,
            "stores its coordinates as normalised integers, which cannot be read: export it with plain numbers "
            "(`gltf-transform dequantize IN OUT`)",
        ),
        (refused, f"holds {refused}"),
        (
            meshes and not parts,
            f"has {len(meshes)} meshes and no scene that places one: export it with the scene that they stand in",
        ),
    )
    for is_refused, why in refusals:
        if is_refused:
            raise SceneError(f"{src} {why}.")
    check_parts(src, parts)
    check_triangles(src, triangles)
    if basis:
        report.add(_BASIS_NOTE, src.name)
    if transformed:
        report.add(TRANSFORMED, src.name)
    for note, names in ((_MORPH_NOTE, morphed), (_SKIN_NOTE, skinned), (UNDECODABLE, junk)):
        for name in names:
            report.add(note, f"{name} of {src.name}")
    return MeshFacts(decodable=not basis and not junk, draco=_DRACO in used | required, uneven=uneven)


def _check_place(gltf: GltfFile, accessor: dict[str, Any]) -> None:
    """Refuse an accessor whose numbers lie nowhere, or over one another."""
    view = gltf.entry("bufferViews", accessor["bufferView"]) if "bufferView" in accessor else {}
    for value in (accessor["count"], accessor.get("byteOffset", 0), view.get("byteOffset", 0)):
        if type(value) is not int or value < 0:
            raise ValueError(f"an accessor has a count or an offset of {value!r}")
    if "bufferView" not in accessor and accessor["count"] > 3 * MAX_TRIANGLES:
        # The library makes as many zeros as it states.
        raise ValueError(f"an accessor states {accessor['count']} elements, and no buffer view holds them")
    element = _BYTES[accessor["componentType"]] * _NUMBERS[accessor["type"]]
    if not element <= view.get("byteStride", element) <= _MAX_STRIDE:
        raise ValueError(f"elements of {element} bytes are stored every {view['byteStride']!r} bytes")


def _check_buffers(gltf: GltfFile) -> None:
    """Refuse a file whose numbers lie in a file that is not there, or too short, or in text that is not base64."""
    src = gltf.src
    for buffer in gltf.listed("buffers"):
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


def _quantised(gltf: GltfFile) -> bool:
    """Whether positions or texture coordinates are integers that stand for fractions."""
    return any(
        accessor.get("normalized", False)
        for primitive in gltf.primitives()
        for name, accessor in gltf.accessors(primitive).items()
        if name in ("POSITION", "TEXCOORD_0")
    )


def _refused(gltf: GltfFile) -> str:
    """What a file holds that the library would take for something else or leave out, and what to do; else empty."""
    for primitive in gltf.primitives():
        mode = primitive.get("mode", _TRIANGLES)
        if mode == _FAN:
            return "a triangle fan, which cannot be read: export it with plain triangles"
        if type(mode) is not int or not 0 <= mode <= _FAN:
            raise ValueError(f"a primitive has the mode {mode!r}, which glTF does not know")
        accessors = gltf.accessors(primitive).values()
        for accessor in accessors:
            _check_place(gltf, accessor)
        if any("sparse" in accessor for accessor in accessors):
            return "a sparse accessor, which cannot be read: export it with plain arrays"
        if "material" in primitive:
            gltf.entry("materials", primitive["material"])
    return ""


def _placed(gltf: GltfFile) -> tuple[int, int]:
    """Primitives and triangles that the nodes of the scene place, each as often as they do."""
    if not gltf.listed("scenes"):
        return 0, 0
    sizes = [
        (len(mesh["primitives"]), sum(_triangles(gltf, primitive) for primitive in mesh["primitives"]))
        for mesh in gltf.listed("meshes")
    ]
    waiting = list(dict.fromkeys(gltf.entry("scenes", gltf.header.get("scene", 0)).get("nodes", [])))
    seen: set[int] = set()
    parts, triangles = 0, 0
    while waiting:
        index = waiting.pop()
        if index in seen:
            # The library would place it once.
            raise ValueError(f"node {index!r} stands in several others, or in itself")
        seen.add(index)
        node = gltf.entry("nodes", index)
        waiting += node.get("children", [])
        if "mesh" in node:
            gltf.entry("meshes", node["mesh"])
            parts, triangles = parts + sizes[node["mesh"]][0], triangles + sizes[node["mesh"]][1]
    return parts, triangles


def _triangles(gltf: GltfFile, primitive: dict[str, Any]) -> int:
    mode, accessors = primitive.get("mode", _TRIANGLES), gltf.accessors(primitive)
    corners = accessors.get("indices", accessors.get("POSITION", {})).get("count", 0)
    return corners // 3 if mode == _TRIANGLES else max(0, corners - 2) if mode == _STRIP else 0


def _morphed(gltf: GltfFile) -> Iterator[str]:
    """Names of the meshes whose vertices default weights move; those that only an animation moves stand still."""
    meshes = gltf.listed("meshes")
    placed = ((node["mesh"], node) for node in gltf.listed("nodes") if "mesh" in node)
    for index, holder in [*enumerate(meshes), *placed]:
        mesh = gltf.entry("meshes", index)
        if any(holder.get("weights", [])) and any("targets" in primitive for primitive in mesh["primitives"]):
            yield f"mesh {mesh.get('name', index)!r}"


def _undecodable(gltf: GltfFile) -> Iterator[str]:
    """Names of the pictures of colours that the library would silently leave out; missing ones are noted elsewhere."""
    textures = {slot["index"]: gltf.entry("textures", slot["index"]) for slot in _colour_slots(gltf)}
    yield from (
        f"texture {index}"
        for index, own in textures.items()
        if _source(own) is None and not {*own.get("extensions", {})} & {*_BASIS}
    )
    for index in dict.fromkeys(source for own in textures.values() if (source := _source(own)) is not None):
        image = gltf.entry("images", index)
        data = gltf.image_bytes(image)
        if data is not None and not is_decodable(data):
            uri = str(image.get("uri", "data:"))
            yield str(image.get("name") or (f"image {index}" if uri.startswith("data:") else uri))


def _colour_slots(gltf: GltfFile) -> list[dict[str, Any]]:
    return [slot for material in gltf.listed("materials") if (slot := colour_slot(material)) is not None]


def _source(texture: dict[str, Any]) -> int | None:
    return texture.get("extensions", {}).get("EXT_texture_webp", texture).get("source")
