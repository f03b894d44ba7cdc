"""Limits of what an import takes: a small file may ask for any amount of memory and time.

Each limit is an environment variable, which the message names, for those who know their file.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from anm_mj.errors import SceneError
from anm_mj.scene.submesh import Submesh
from anm_mj.utils.file_limits import MAX_TEXTURE_MEGAPIXELS, limit

MAX_MESH_MIB = limit("ANM_MJ_MAX_MESH_MIB", 4096)
MAX_PARTS = limit("ANM_MJ_MAX_PARTS", 5000)
"""Most meshes, with materials of their own, in one file."""
MAX_TRIANGLES = limit("ANM_MJ_MAX_TRIANGLES", 6_000_000)
"""Most triangles of a scene, copies counted."""
MAX_SPREAD_KM = limit("ANM_MJ_MAX_SPREAD_KM", 250)
"""Largest sum of what triangles extend along one axis beyond a few centimetres [km]."""

_COPY_TRIANGLES = 500
"""Cost of copying a mesh, however small it is, in triangles."""
_NEAR_M = 0.05
"""Triangles that extend less cover a cell or two of every grid [m]."""


class LimitError(SceneError):
    """A source asks for more than the limits allow; what is within it is not left out for that."""


def check_size(src: Path, size_bytes: int) -> None:
    """Raises LimitError for a mesh file that is too large."""
    if size_bytes > MAX_MESH_MIB << 20:
        raise LimitError(
            f"{src} has {size_bytes >> 20} MiB, but files end at {MAX_MESH_MIB}: set ANM_MJ_MAX_MESH_MIB if it is as "
            "large as it should be."
        )


def check_parts(src: Path, parts: int) -> None:
    """Raises LimitError for a mesh file of too many parts."""
    if parts > MAX_PARTS:
        raise LimitError(
            f"{src} consists of {parts:.4g} meshes, but files end at {MAX_PARTS}: join them, or set ANM_MJ_MAX_PARTS "
            "to allow more."
        )


def check_triangles(src: Path, triangles: int) -> None:
    """Raises LimitError for a file of too many triangles."""
    if triangles > MAX_TRIANGLES:
        raise LimitError(
            f"{src} has {triangles:.4g} triangles, all copies counted, but scenes end at {MAX_TRIANGLES:.4g}: simplify "
            "its meshes, or set ANM_MJ_MAX_TRIANGLES to allow more."
        )


def check_spread(src: Path, triangles_m: Float[np.ndarray, "f 3 3"]) -> None:
    """Raises LimitError for large triangles that lie over one another: each is drawn into grids row by row."""
    beyond_m = np.maximum(np.ptp(triangles_m, axis=1) - _NEAR_M, 0.0)
    spread_km = float(beyond_m.sum(axis=0).max(initial=0.0)) / 1e3
    if spread_km > MAX_SPREAD_KM:
        raise LimitError(
            f"{src} has {len(triangles_m):.4g} triangles that extend over {spread_km:.4g} km together, but scenes end "
            f"at {MAX_SPREAD_KM} km: large ones lie over one another; place each mesh once, or set "
            "ANM_MJ_MAX_SPREAD_KM to allow more."
        )


def check_includes(src: Path, number: int) -> None:
    """Raises LimitError for a world that includes too many models, which may include others."""
    most = MAX_TRIANGLES // _COPY_TRIANGLES
    if number > most:
        raise LimitError(
            f"{src} includes more than {most} models, those in one another counted: include fewer, or set "
            "ANM_MJ_MAX_TRIANGLES to allow more."
        )


@dataclass
class TriangleBudget:
    """Counts the triangles of a world or scene, which may place one mesh any number of times."""

    _src: Path
    _triangles: int = 0

    def spend(self, submesh: Submesh) -> None:
        """Count a copy of a submesh before it is made; raises LimitError if there are too many triangles with it."""
        self._triangles += max(_COPY_TRIANGLES, len(submesh.faces))
        if self._triangles > MAX_TRIANGLES:
            raise LimitError(
                f"{self._src} places more than {MAX_TRIANGLES:.4g} triangles with the copies of its meshes (a copy "
                f"counts for {_COPY_TRIANGLES} at least): place fewer, or set ANM_MJ_MAX_TRIANGLES to allow more."
            )


def check_textures(src: Path, sizes_px: Iterable[tuple[int, int]], kept_px: int) -> None:
    """Raises LimitError for a mesh file whose pictures have too many pixels together, before any is decoded.

    Pixels beyond ``kept_px`` a side take time, but no memory for long.
    """
    total = 0.0
    for size in sizes_px:
        megapixels = size[0] * size[1] / 1e6
        kept = megapixels * min(1.0, kept_px / max(*size, 1)) ** 2
        total += kept + (megapixels - kept) / 4.0
    if total > MAX_TEXTURE_MEGAPIXELS:
        raise LimitError(
            f"{src} has more than {MAX_TEXTURE_MEGAPIXELS} megapixels of textures: store pictures that are the same "
            "once, shrink them, or set ANM_MJ_MAX_TEXTURE_MEGAPIXELS to allow more."
        )
