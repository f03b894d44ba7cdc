"""Limits of what an import takes: a small file may ask for any amount of memory and time.

Each limit is an environment variable, which the message names, for those who know their file.
"""

from __future__ import annotations

from pathlib import Path

from anm_mj.errors import SceneError
from anm_mj.scene.submesh import Submesh
from anm_mj.utils.limits import limit

MAX_MESH_MIB = limit("ANM_MJ_MAX_MESH_MIB", 4096)
"""Largest mesh file [MiB]."""
MAX_PARTS = limit("ANM_MJ_MAX_PARTS", 5000)
"""Most meshes, with materials of their own, in one file."""
MAX_TRIANGLES = limit("ANM_MJ_MAX_TRIANGLES", 6_000_000)
"""Most triangles of a scene, copies counted."""
MAX_TEXTURE_MEGAPIXELS = limit("ANM_MJ_MAX_TEXTURE_MEGAPIXELS", 500)
"""Most megapixels in the textures of one mesh file."""

_COPY_TRIANGLES = 500
"""A copy of a mesh takes as much time as so many triangles, however small it is."""


def check_size(src: Path, size_bytes: int) -> None:
    """Refuse a mesh file that is too large.

    Raises:
        SceneError: if it is.
    """
    if size_bytes > MAX_MESH_MIB << 20:
        raise SceneError(
            f"{src} has {size_bytes >> 20} MiB, but files end at {MAX_MESH_MIB}: set ANM_MJ_MAX_MESH_MIB if it is as "
            "large as it should be."
        )


def check_parts(src: Path, parts: int) -> None:
    """Refuse a mesh file of too many parts.

    Raises:
        SceneError: if it has.
    """
    if parts > MAX_PARTS:
        raise SceneError(
            f"{src} consists of {parts:.4g} meshes, but files end at {MAX_PARTS}: join them, or set ANM_MJ_MAX_PARTS "
            "if there should be so many."
        )


def check_triangles(src: Path, triangles: int) -> None:
    """Refuse a file of too many triangles.

    Raises:
        SceneError: if it has.
    """
    if triangles > MAX_TRIANGLES:
        raise SceneError(
            f"{src} has {triangles:.4g} triangles, all copies counted, but scenes end at {MAX_TRIANGLES:.4g}: simplify "
            "its meshes, or set ANM_MJ_MAX_TRIANGLES if there should be so many."
        )


class TriangleBudget:
    """Counts the triangles of a world or scene, which may place one mesh any number of times."""

    def __init__(self, src: Path) -> None:
        self._src = src
        self._triangles = 0

    def spend(self, submesh: Submesh) -> None:
        """Count a copy of a submesh before it is made.

        Raises:
            SceneError: if there are too many triangles with it.
        """
        self._triangles += max(_COPY_TRIANGLES, len(submesh.faces))
        if self._triangles > MAX_TRIANGLES:
            raise SceneError(
                f"{self._src} places more than {MAX_TRIANGLES:.4g} triangles with the copies of its meshes (a copy "
                f"counts for {_COPY_TRIANGLES} at least): place fewer, or set ANM_MJ_MAX_TRIANGLES if there should be "
                "so many."
            )


class TextureBudget:
    """Counts the pixels in the textures of a mesh file, which may name one picture any number of times."""

    def __init__(self, src: Path, kept_px: int) -> None:
        self._src = src
        self._kept_px = kept_px
        self._megapixels = 0.0

    def spend(self, size: tuple[int, int]) -> None:
        """Count a picture before it is decoded; pixels beyond ``kept_px`` a side take time, but no memory for long.

        Raises:
            SceneError: if there are too many pixels with it.
        """
        megapixels = size[0] * size[1] / 1e6
        kept = megapixels * min(1.0, self._kept_px / max(*size, 1)) ** 2
        self._megapixels += kept + (megapixels - kept) / 4.0
        if self._megapixels > MAX_TEXTURE_MEGAPIXELS:
            raise SceneError(
                f"{self._src} has more than {MAX_TEXTURE_MEGAPIXELS} megapixels of textures: store pictures that are "
                "the same once, shrink them, or set ANM_MJ_MAX_TEXTURE_MEGAPIXELS if there should be so many."
            )
