"""How a visual of an SDF file looks: one colour or one texture.

Gazebo lights its scenes; here a surface shows its diffuse colour as it is, or that of its own light if it is black. In
falling order: the albedo map of a PBR material, the diffuse colour, the material script's texture or diffuse colour,
the ambient colour.
"""

from __future__ import annotations

import math
import os
import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from anm_mj.scene.importing.readers.import_report import LEFT_OUT, ImportReport
from anm_mj.scene.importing.readers.model_path import Places, find_uri
from anm_mj.scene.importing.readers.sdf_pose import numbers, text_of
from anm_mj.scene.importing.readers.texture_file import MISSING, find_texture, flat_coloured, read_texture
from anm_mj.scene.submesh import Submesh
from anm_mj.utils.read_file import read_bytes

_UNKNOWN_SCRIPT = "Not found: the materials {names}; what is made of them comes out grey."
_MAX_SCRIPT_MIB = 16
_SMALLEST_SCALE = 1e-6
"""Textures that should repeat more often are not scaled."""

Rgb = tuple[float, float, float]

_GAZEBO_RGB: dict[str, Rgb] = {
    "Black": (0.0, 0.0, 0.0), "Blue": (0.0, 0.0, 1.0), "Bricks": (0.55, 0.33, 0.26),
    "CeilingTiled": (0.85, 0.85, 0.83), "DarkGray": (0.175, 0.175, 0.175), "DarkYellow": (0.7, 0.7, 0.0),
    "FlatBlack": (0.1, 0.1, 0.1), "Gold": (0.8, 0.65, 0.25), "Grass": (0.25, 0.40, 0.17), "Gray": (0.7, 0.7, 0.7),
    "Green": (0.0, 1.0, 0.0), "Indigo": (0.33, 0.0, 0.5), "LightWood": (0.80, 0.65, 0.45),
    "Orange": (1.0, 0.51, 0.05), "PaintedWall": (0.80, 0.78, 0.72), "Purple": (1.0, 0.0, 1.0),
    "Red": (1.0, 0.0, 0.0), "Residential": (0.75, 0.70, 0.62), "Road": (0.30, 0.30, 0.30),
    "SkyBlue": (0.13, 0.44, 0.70), "Turquoise": (0.0, 1.0, 1.0), "White": (1.0, 1.0, 1.0),
    "Wood": (0.61, 0.45, 0.28), "WoodFloor": (0.58, 0.42, 0.27), "WoodPallet": (0.65, 0.52, 0.36),
    "Yellow": (1.0, 1.0, 0.0), "ZincYellow": (0.97, 0.95, 0.21),
}  # fmt: skip
"""Colours of Gazebo's own materials, for worlds imported where Gazebo is not installed; of those with a texture, a
colour like it."""


@dataclass(frozen=True, eq=False)
class Material:
    """Colour or texture of a surface."""

    rgb: Rgb
    texture: UInt8[np.ndarray, "h w 3"] | None = None
    uv_scale: tuple[float, float] = (1.0, 1.0)
    """How often the texture repeats from 0 to 1."""


@dataclass
class MaterialReader:
    """Reads the materials of one world; every script and texture once."""

    _places: Places
    _report: ImportReport
    _textures: dict[Path, UInt8[np.ndarray, "h w 3"] | None] = field(default_factory=dict)
    _scripts: dict[Path, dict[str, _Script]] = field(default_factory=dict)

    def read(self, element: ET.Element | None, folder: Path) -> Material | None:
        """The material of a <material> in a file of ``folder``, if any. Raises SceneError if a colour is no numbers."""
        if element is None:
            return None
        albedo = text_of(element, "pbr/*/albedo_map")
        diffuse, ambient = _colour(element.find("diffuse")), _colour(element.find("ambient"))
        texture = self._texture(albedo, [folder], folder) if albedo else None
        if texture is not None:
            return Material((1.0, 1.0, 1.0), texture)
        if diffuse is not None:
            light = _colour(element.find("emissive"))
            return Material(diffuse if light is None or any(diffuse) else light)
        script = element.find("script")
        name = "" if script is None else text_of(script, "name")
        scripted = self._scripted(name, script, folder) if script is not None and name else None
        return scripted or (None if ambient is None else Material(ambient))

    def _scripted(self, name: str, script: ET.Element, folder: Path) -> Material | None:
        uris = [find_uri(uri.text or "", folder, self._places, self._report) for uri in script.findall("uri")]
        places = [place for place in uris if place is not None]
        listed = [[place] if os.path.isfile(place) else sorted(place.glob("*.material")) for place in places]
        # A file in a folder may be linked from elsewhere.
        files = [file for files in listed for file in files if self._places.first([file], folder, self._report)]
        for file in files:
            found = self._script_file(file).get(name)
            if found is not None and found.texture is not None:
                texture = self._texture(found.texture, [*places, file.parent], folder)
                if texture is not None:
                    return Material((1.0, 1.0, 1.0), texture, found.uv_scale)
            if found is not None and found.diffuse is not None:
                return Material(found.diffuse)
        plain = re.sub(r"(Glow|TransparentOverlay|Transparent|Bright)$", "", name.rpartition("/")[2])
        plain = plain.replace("Grey", "Gray")
        if name.startswith("Gazebo/") and plain in _GAZEBO_RGB:
            return Material(_GAZEBO_RGB[plain])
        self._report.add(_UNKNOWN_SCRIPT, name)
        return None

    def _texture(self, name: str, places: list[Path], folder: Path) -> UInt8[np.ndarray, "h w 3"] | None:
        path = find_uri(name, folder, self._places, self._report) if "://" in name else None
        for place in places:
            path = path or find_texture(name, place if os.path.isdir(place) else place.parent)
        if path is not None and os.path.isfile(path):
            if path not in self._textures:
                self._textures[path] = read_texture(path)
            if self._textures[path] is not None:
                return self._textures[path]
        self._report.add(MISSING, name.rpartition("/")[2])
        return None

    def _script_file(self, path: Path) -> dict[str, _Script]:
        """The materials of a script file; none, with a note, if it cannot be read."""
        if path not in self._scripts:
            try:
                text = read_bytes(path, _MAX_SCRIPT_MIB).decode("utf-8", errors="replace")
            except (OSError, ValueError) as err:
                self._report.add(LEFT_OUT, f"{path.name} ({err})")
                text = ""
            self._scripts[path] = read_script(text)
        return self._scripts[path]


@dataclass(frozen=True)
class _Script:
    diffuse: Rgb | None
    texture: str | None
    uv_scale: tuple[float, float]


_COMMENT = re.compile(r"/\*.*?(?:\*/|\Z)|//[^\n]*", re.DOTALL)
_HEAD = re.compile(r"\bmaterial\s++(\"[^\"\n]++\"|(?>[^\s{]*[^\s{:]))(?:\s*+:\s*+([^\s{]++))?\s*+\{")
"""The beginning of a material; a pattern that never goes back over what it has read."""


def read_script(text: str) -> dict[str, _Script]:
    """The materials of an OGRE material script, by name: the first diffuse colour and texture of each."""
    text = _COMMENT.sub("", text)
    materials: dict[str, _Script] = {}
    heads = list(_HEAD.finditer(text))
    ends = [*(head.start() for head in heads[1:]), len(text)]
    for head, end in zip(heads, ends, strict=False):
        body = _body(text, head.end(), end)
        diffuse, scale = _first_numbers("diffuse", 3, body), _first_numbers("scale", 2, body)
        texture = re.search(r"\btexture\s+(\S+)", body)
        found = materials.get((head[2] or "").strip('"')) or _Script(None, None, (1.0, 1.0))
        if diffuse is not None:
            found = replace(found, diffuse=_clipped(diffuse))
        if texture is not None:
            found = replace(found, texture=texture[1])
        if scale is not None and min(map(abs, scale)) > _SMALLEST_SCALE:
            # OGRE's scale is that of the picture: half its size shows it twice.
            found = replace(found, uv_scale=(1.0 / scale[0], 1.0 / scale[1]))
        materials[head[1].strip('"')] = found
    return materials


def _body(text: str, start: int, end: int) -> str:
    """What stands between a brace, which ends at ``start``, and the one that closes it; the next material closes it."""
    depth = 1
    for brace in re.finditer(r"[{}]", text[start:end]):
        depth += 1 if brace[0] == "{" else -1
        if not depth:
            return text[start : start + brace.start()]
    return text[start:end]


def _first_numbers(keyword: str, count: int, body: str) -> tuple[float, ...] | None:
    """The numbers after the first such keyword that has some; None if there is none, or they are no numbers."""
    found = re.search(rf"\b{keyword}((?:\s+[\d.eE+-]+){{{count}}})", body)
    try:
        values = () if found is None else tuple(float(word) for word in found[1].split())
    except ValueError:
        return None
    return values if values and all(math.isfinite(value) for value in values) else None


def with_material(submesh: Submesh, material: Material) -> Submesh:
    """The submesh with a material; without texture coordinates a texture becomes its mean colour."""
    if material.texture is None:
        return replace(submesh, rgb=material.rgb, texture=None, tiled=False)
    if submesh.uv is None or submesh.tiled:
        uv = np.zeros((len(submesh.vertices_m), 2))
        return flat_coloured(replace(submesh, rgb=material.rgb, uv=uv, texture=material.texture, tiled=False))
    return replace(submesh, rgb=material.rgb, uv=submesh.uv * material.uv_scale, texture=material.texture)


def _colour(element: ET.Element | None) -> Rgb | None:
    return None if element is None else _clipped(numbers(element, 3, (0.0, 0.0, 0.0)))


def _clipped(values: tuple[float, ...]) -> Rgb:
    red, green, blue = (min(1.0, max(0.0, value)) for value in values)
    return red, green, blue
