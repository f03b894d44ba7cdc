"""Limits of what an import takes: a small file may ask for any amount of memory and time.

Each limit is an environment variable, which the message names, for those who know their file.
"""

from __future__ import annotations

from pathlib import Path

from anm_mj.errors import SceneError
from anm_mj.utils.limits import limit

MAX_MESH_MIB = limit("ANM_MJ_MAX_MESH_MIB", 4096)
"""Largest mesh file [MiB]."""
MAX_PARTS = limit("ANM_MJ_MAX_PARTS", 5000)
"""Most meshes, with materials of their own, in one file."""


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
