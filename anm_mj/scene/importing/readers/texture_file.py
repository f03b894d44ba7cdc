"""Textures: finds and reads the images that mesh files refer to, and limits them to what a laptop takes."""

from __future__ import annotations

import io
import logging
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote

import numpy as np
from jaxtyping import UInt8
from PIL import Image
from trimesh.resolvers import FilePathResolver

from anm_mj.scene.importing.readers.import_limits import MAX_MESH_MIB
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.raster import areas
from anm_mj.scene.submesh import Submesh
from anm_mj.utils.picture import open_picture
from anm_mj.utils.read_file import is_below, read_bytes

_logger = logging.getLogger(__name__)

MAX_TEXTURE_PX = 1024
"""At the robot's image size, larger textures cost memory and time, and alias."""
MAX_TEXTURES = 960
"""MuJoCo draws at most 1000 textures and textured materials (mjrender.h); a robot's own need some."""
MAX_TEXELS = 128 * 1024 * 1024
"""A texel is 3 bytes of main memory and, with its coarser levels, 5 of the renderer's: 1 GB in all."""
_MIN_SIDE_PX = 64

MISSING = "Not found: {names}; surfaces that need them come out plain."
TRANSFORMED = "Texture transforms are not applied, so the textures of {names} may come out shifted or scaled."
UNDECODABLE = "These pictures cannot be decoded: {names}; surfaces that need them come out plain."


def find_texture(name: str, folder: Path) -> Path | None:
    """The file that a mesh or material in ``folder`` means by ``name``, or None.

    It lies in the folder or beside it, as a model's ``textures`` lie beside its ``meshes``: a file from elsewhere must
    not get into a scene because somebody's mesh names it.
    """
    name = unquote(name.strip()).replace("\\", "/")
    last = Path(name).name
    places = [folder / name, folder / name.lstrip("/"), folder / last]
    places += [folder.parent / below / last for below in ("materials/textures", "textures", "materials", "meshes")]
    own = folder.resolve().parent
    return next((place for place in places if os.path.isfile(place) and is_below(place, own)), None) if last else None


def files_of_words(name: str, folder: Path) -> list[Path | None]:
    """The files that a line of an OBJ file means, which may name several material files; None for each one missing."""
    whole = find_texture(name, folder)
    return [find_texture(word, folder) for word in name.split()] if whole is None else [whole]


def is_decodable(picture: bytes) -> bool:
    """Whether the beginning of a picture file is that of one."""
    try:
        Image.open(io.BytesIO(picture)).close()
    # Pillow raises whatever a decoder stumbles over.
    except Exception:
        return False
    return True


def read_texture(path: Path) -> UInt8[np.ndarray, "h w 3"] | None:
    """An image file as RGB of at most 1024 px a side, or None if it cannot be decoded."""
    try:
        with open_picture(path) as image:
            return shrunk(image)
    # Pillow raises whatever a decoder stumbles over.
    except Exception:
        return None


def shrunk(image: Image.Image) -> UInt8[np.ndarray, "h w 3"]:
    """An image as RGB of at most 1024 px a side; the opacity channel is dropped."""
    if max(image.size) > MAX_TEXTURE_PX:
        # A JPEG that is not decoded yet is decoded at a fraction of its size, which saves most of the memory.
        image.draft("RGB", (MAX_TEXTURE_PX, MAX_TEXTURE_PX))
    return resized(np.array(_eight_bit(image).convert("RGB")), MAX_TEXTURE_PX)


def _eight_bit(image: Image.Image) -> Image.Image:
    """A picture of one number of 16 bits or a float per pixel with 8 bits, which Pillow cuts off instead of scaling."""
    if image.mode.startswith("I"):
        return Image.fromarray((np.clip(np.asarray(image), 0, 65535) >> 8).astype(np.uint8))
    if image.mode == "F":
        return Image.fromarray(np.round(np.clip(np.nan_to_num(np.asarray(image)), 0.0, 1.0) * 255.0).astype(np.uint8))
    return image


def resized(texture: UInt8[np.ndarray, "h w 3"], side_px: int) -> UInt8[np.ndarray, "rows cols 3"]:
    """A texture whose larger side is at most ``side_px``."""
    largest = max(texture.shape[:2])
    if largest <= side_px:
        return texture
    height, width = (max(1, round(side * side_px / largest)) for side in texture.shape[:2])
    return np.array(Image.fromarray(texture).resize((width, height), Image.Resampling.LANCZOS))


def limit_textures(submeshes: list[Submesh]) -> list[Submesh]:
    """The submeshes with fewer and smaller textures, if there are too many or they are too large together.

    The textures with the smallest surface become their mean colour. The largest textures are halved until all fit;
    those with a tile per triangle keep their size. The log reports both.
    """
    submeshes = _fewest(submeshes)
    textured = {id(own.texture): (own.texture, own.tiled) for own in submeshes if own.texture is not None}
    side = MAX_TEXTURE_PX
    while sum(_texels(*own, side) for own in textured.values()) > MAX_TEXELS and side > _MIN_SIDE_PX:
        side //= 2
    if side == MAX_TEXTURE_PX:
        return submeshes
    _logger.warning("the textures are large together: they were reduced to %d px a side", side)
    small = {key: resized(texture, side) for key, (texture, tiled) in textured.items() if not tiled}
    return [replace(submesh, texture=small.get(id(submesh.texture), submesh.texture)) for submesh in submeshes]


def _texels(texture: UInt8[np.ndarray, "h w 3"], tiled: bool, side: int) -> int:
    """Number of texels of a texture if it, unless it is tiled, were at most ``side`` wide and high."""
    height, width, _ = texture.shape
    share = 1.0 if tiled else min(1.0, side / max(height, width))
    return int(height * width * share**2)


def _fewest(submeshes: list[Submesh]) -> list[Submesh]:
    area_m2: dict[tuple[int, tuple[float, float, float]], float] = {}
    for submesh in submeshes:
        if submesh.texture is not None:
            material = (id(submesh.texture), submesh.rgb)
            area_m2[material] = area_m2.get(material, 0.0) + float(areas(submesh.vertices_m[submesh.faces]).sum())
    if len(area_m2) <= MAX_TEXTURES:
        return submeshes
    kept = set(sorted(area_m2, key=lambda material: -area_m2[material])[:MAX_TEXTURES])
    _logger.warning(
        "the scene has %d textures, but at most %d can be drawn: the %d on the least surface became plain colours",
        len(area_m2),
        MAX_TEXTURES,
        len(area_m2) - MAX_TEXTURES,
    )
    return [own if (id(own.texture), own.rgb) in kept else flat_coloured(own) for own in submeshes]


def flat_coloured(submesh: Submesh) -> Submesh:
    """The same submesh in the mean colour of its texture, if it has one."""
    if submesh.texture is None:
        return submesh
    red, green, blue = submesh.texture.reshape(-1, 3).mean(axis=0) / 255.0 * submesh.rgb
    return replace(submesh, rgb=(float(red), float(green), float(blue)), uv=None, texture=None, tiled=False)


class MeshNeighbours(FilePathResolver):
    """Serves the files that a mesh file names to trimesh, and reports those that are nowhere.

    A name is looked for as it stands, with backslashes turned, and by its last part beside the mesh and where Gazebo
    models keep their textures.
    """

    def __init__(self, mesh: Path, report: ImportReport, even: Callable[[bytes], bytes] = bytes) -> None:
        """``even`` writes a material file as the library expects it."""
        super().__init__(str(mesh), allow_anywhere=True)
        self._even = even
        self._mesh = mesh
        self._folder = mesh.absolute().parent
        self._report = report
        self.missed = False
        """Whether a file was asked for that is nowhere, or a picture that cannot be decoded."""

    def get(self, name: str) -> bytes:
        """Bytes of a named file. Raises OSError if it cannot be read, and ValueError if it is too large."""
        paths = files_of_words(name, self._folder)
        found = [path for path in paths if path is not None]
        if not found or len(found) < len(paths):
            self.missed = True
            self._report.add(MISSING, Path(name.replace("\\", "/")).name)
            raise FileNotFoundError(name)
        content = b"\n".join(read_bytes(path, MAX_MESH_MIB) for path in found)
        # The library would leave it out without a word; pictures of glTF files are looked at before.
        if found[0].suffix.lower() == ".mtl":
            return self._even(content)
        if self._mesh.suffix.lower() not in (".glb", ".gltf") and not is_decodable(content):
            self.missed = True
            self._report.add(UNDECODABLE, f"{found[0].name} of {self._mesh.name}")
        return content

    def namespaced(self, namespace: str) -> MeshNeighbours:
        """The same for the files of a subfolder."""
        return MeshNeighbours(self._folder / namespace / "_", self._report, self._even)


class TextureStore:
    """Decoded textures of one mesh file, each once; an image is closed as soon as it is decoded."""

    def __init__(self) -> None:
        # Images stay beside their ids: a freed one could lend its id to another.
        self._decoded: dict[int, tuple[Image.Image, UInt8[np.ndarray, "h w 3"]]] = {}

    def texture(self, image: Image.Image) -> UInt8[np.ndarray, "h w 3"]:
        """The texture of an image."""
        if id(image) not in self._decoded:
            self._decoded[id(image)] = image, shrunk(image)
            image.close()
        return self._decoded[id(image)][1]
