"""A glTF file as it is stored: its JSON, the lists in it that name one another, and the bytes of its images."""

import base64
import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from anm_mj.scene.importing.readers.import_limits import MAX_MESH_MIB
from anm_mj.scene.importing.readers.texture_file import find_texture
from anm_mj.utils.read_file import open_regular, parse_json, read_bytes

_UNSIGNED_SHORT = 5123


@dataclass(frozen=True)
class GltfFile:
    """A glTF file whose JSON is read; entries of its lists are not checked before they are asked for."""

    src: Path
    header: dict[str, Any]
    body: int
    """Where the buffer of a .glb begins; 0 for a .gltf [bytes]."""
    _unpacked: dict[str, bytes] = field(default_factory=dict)

    def listed(self, kind: str) -> list[Any]:
        """All entries of a kind, such as "meshes"."""
        return self.header.get(kind, [])

    def entry(self, kind: str, index: Any) -> dict[str, Any]:
        """An entry by its index; raises ValueError for a negative one, which Python and the library would take."""
        entries = self.listed(kind)
        if type(index) is not int or not 0 <= index < len(entries):
            raise ValueError(f"it names entry {index!r} of its {len(entries)} {kind}")
        return entries[index]

    def primitives(self) -> Iterator[dict[str, Any]]:
        """All primitives of all meshes."""
        return (primitive for mesh in self.listed("meshes") for primitive in mesh["primitives"])

    def accessors(self, primitive: dict[str, Any]) -> dict[str, dict[str, Any]]:
        """The accessors of a primitive that are read, by what they are for."""
        named = {**primitive["attributes"], "indices": primitive.get("indices")}
        return {
            name: self.entry("accessors", named[name])
            for name in ("POSITION", "TEXCOORD_0", "COLOR_0", "indices")
            if named.get(name) is not None
        }

    def even_primitive(self, primitive: dict[str, Any]) -> dict[str, Any]:
        """A primitive with what the library takes from elsewhere than the format says, where it looks.

        It reads the first texture coordinates, whichever the material asks for, and cuts off colours of 16 bits unless
        there is a material; the default one stands behind all others.
        """
        even = {**primitive, "attributes": {**primitive["attributes"]}}
        named = even["attributes"]
        if "material" not in primitive:
            if "COLOR_0" in named and self.entry("accessors", named["COLOR_0"])["componentType"] == _UNSIGNED_SHORT:
                even["material"] = len(self.listed("materials"))
            return even
        slot = colour_slot(self.entry("materials", primitive["material"])) or {}
        wanted = slot.get("extensions", {}).get("KHR_texture_transform", {}).get("texCoord", slot.get("texCoord", 0))
        if wanted != 0 and f"TEXCOORD_{wanted}" in named:
            named["TEXCOORD_0"] = named[f"TEXCOORD_{wanted}"]
        return even

    def image_bytes(self, image: dict[str, Any]) -> bytes | None:
        """An image as it is stored; None if its file is missing."""
        if "bufferView" not in image:
            return self._uri_bytes(str(image["uri"]))
        view = self.entry("bufferViews", image["bufferView"])
        uri = self.entry("buffers", view["buffer"]).get("uri")
        start, length = view.get("byteOffset", 0), view["byteLength"]
        if uri is not None:
            data = self._uri_bytes(str(uri))
            return None if data is None else data[start : start + length]
        with open_regular(self.src) as file:
            file.seek(self.body + start)
            return file.read(length)

    def _uri_bytes(self, uri: str) -> bytes | None:
        if uri.startswith("data:") and uri not in self._unpacked:
            self._unpacked[uri] = base64.b64decode(uri.partition(",")[2])
        elif uri not in self._unpacked:
            path = find_texture(uri, self.src.absolute().parent)
            if path is None:
                return None
            with open_regular(path) as file:
                self._unpacked[uri] = file.read()
        return self._unpacked[uri]


def open_gltf(src: Path, size: int) -> GltfFile:
    """A .gltf or .glb of ``size`` bytes. Raises OSError, ValueError or struct.error if it cannot be read or is none."""
    body = 0
    with open_regular(src) as file:
        if src.suffix.lower() == ".glb":
            # glTF 2.0, section 4.4.
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
    return GltfFile(src, header, body)


def gltf_nodes(gltf: GltfFile) -> dict[str, set[str]]:
    """The names of the meshes that the nodes of a glTF file place, by the names of the nodes. Raises ValueError if a
    node names no mesh.
    """
    found: dict[str, set[str]] = {}
    for index, node in enumerate(gltf.listed("nodes")):
        # Meshes without a name get this one from the library.
        names = {gltf.entry("meshes", node["mesh"]).get("name", "GLTF")} if "mesh" in node else set()
        found.setdefault(str(node.get("name", index)), set()).update(names)
    return found


def even_gltf(src: Path) -> bytes:
    """A glTF file without cameras, primitives as :meth:`GltfFile.even_primitive` has them. Raises ValueError if it
    cannot be read.
    """
    content = read_bytes(src, MAX_MESH_MIB)
    gltf = open_gltf(src, len(content))
    for mesh in gltf.header["meshes"]:
        mesh["primitives"] = [gltf.even_primitive(primitive) for primitive in mesh["primitives"]]
    for node in gltf.listed("nodes"):
        node.pop("camera", None)
    gltf.header.setdefault("materials", []).append({})
    text = json.dumps(gltf.header).encode()
    if not gltf.body:
        return text
    text += b" " * (-len(text) % 4)
    rest = content[gltf.body - 8 :]
    return struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON") + text + rest


def colour_slot(material: dict[str, Any]) -> dict[str, Any] | None:
    """How a material names the texture of its colour, or of its light where it is black; None without one."""
    own = material.get("pbrMetallicRoughness", {})
    if any(material.get("emissiveFactor", ())) and not any(own.get("baseColorFactor", (1.0,))[:3]):
        return material.get("emissiveTexture")
    gloss = material.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness", {})
    return own.get("baseColorTexture", gloss.get("diffuseTexture"))
