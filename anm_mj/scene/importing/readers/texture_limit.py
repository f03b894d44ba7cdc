"""Limits number and size of textures to what the renderer and the memory of a laptop take."""

import logging
from dataclasses import replace

import numpy as np
from jaxtyping import UInt8

from anm_mj.scene.importing.readers.texture_file import MAX_TEXTURE_PX, resized
from anm_mj.scene.raster import areas
from anm_mj.scene.submesh import Submesh

_logger = logging.getLogger(__name__)

MAX_TEXTURES = 960
"""MuJoCo draws at most 1000 textures and textured materials (mjrender.h); a robot's own need some."""
MAX_TEXELS = 128 * 1024 * 1024
"""A texel is 3 bytes of main memory and, with its coarser levels, 5 of the renderer's: 1 GB in all."""
_MIN_SIDE_PX = 64


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
