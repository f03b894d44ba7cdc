"""Keeps a scene's textures within what a renderer takes and a laptop's memory holds."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
from jaxtyping import UInt8

from anm_mj.scene.importing.readers.texture_file import MAX_TEXTURE_PX, resized
from anm_mj.scene.raster import areas
from anm_mj.scene.submesh import Part

_logger = logging.getLogger(__name__)

MAX_TEXTURES = 960
"""MuJoCo draws at most 1000 textures and textured materials (mjrender.h); a robot's own need some."""
MAX_TEXELS = 128 * 1024 * 1024
"""A texel is 3 bytes of main memory and, with its coarser levels, 5 of the renderer's: 1 GB in all."""
_MIN_SIDE_PX = 64


def limit_textures(parts: list[Part]) -> list[Part]:
    """The same parts with fewer and smaller textures, if they are too many or too large together.

    Of too many textures, those on the least surface give way to their mean colour. Too large ones are halved, the
    largest first, until all fit; textures that hold a tile per triangle keep their size. Both are said in the log.
    """
    parts = _fewest(parts)
    side = MAX_TEXTURE_PX
    while _texels(parts, side) > MAX_TEXELS and side > _MIN_SIDE_PX:
        side //= 2
    if side < MAX_TEXTURE_PX:
        _logger.warning("the textures are large together: they were reduced to %d px a side", side)
        small: dict[int, UInt8[np.ndarray, "h w 3"]] = {}
        for texture in _textures([part for part in parts if not part.tiled]).values():
            small[id(texture)] = resized(texture, side)
        parts = [
            part if part.texture is None else replace(part, texture=small.get(id(part.texture), part.texture))
            for part in parts
        ]
    return parts


def _textures(parts: list[Part]) -> dict[int, UInt8[np.ndarray, "h w 3"]]:
    """Every texture once."""
    return {id(part.texture): part.texture for part in parts if part.texture is not None}


def _texels(parts: list[Part], side: int) -> int:
    """Number of texels if textures that may be reduced were at most ``side`` wide and high."""
    total = 0
    sizes = {id(part.texture): (part.texture.shape, part.tiled) for part in parts if part.texture is not None}
    for shape, tiled in sizes.values():
        share = 1.0 if tiled else min(1.0, side / max(shape[:2]))
        total += int(shape[0] * shape[1] * share**2)
    return total


def _fewest(parts: list[Part]) -> list[Part]:
    """Parts with at most MAX_TEXTURES looks that need a texture."""
    area_m2: dict[tuple[int, tuple[float, float, float]], float] = {}
    for part in parts:
        if part.texture is not None:
            look = (id(part.texture), part.rgb)
            area_m2[look] = area_m2.get(look, 0.0) + float(areas(part.vertices_m[part.faces]).sum())
    if len(area_m2) <= MAX_TEXTURES:
        return parts
    kept = set(sorted(area_m2, key=lambda look: -area_m2[look])[:MAX_TEXTURES])
    _logger.warning(
        "the scene has %d textures, but at most %d can be drawn: the %d on the least surface became plain colours",
        len(area_m2),
        MAX_TEXTURES,
        len(area_m2) - MAX_TEXTURES,
    )
    return [
        flat_coloured(part) if part.texture is not None and (id(part.texture), part.rgb) not in kept else part
        for part in parts
    ]


def flat_coloured(part: Part) -> Part:
    """The same part in the mean colour of its texture."""
    if part.texture is None:
        return part
    red, green, blue = part.texture.reshape(-1, 3).mean(axis=0) / 255.0 * part.rgb
    return replace(part, rgb=(float(red), float(green), float(blue)), uv=None, texture=None, tiled=False)
