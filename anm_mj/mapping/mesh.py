"""Triangles of the observed surface: the field's zero level, piece by piece, kept where nothing has changed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32, Int64, UInt8

from anm_mj.errors import MapError
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.lattice import Cells, active_cells, march, merge_vertices, remove_unreferenced
from anm_mj.mapping.occupancy_kernels import BLOCK
from anm_mj.mapping.surface import REACH_VOXELS
from anm_mj.types import OCCUPIED, SdfQuery

if TYPE_CHECKING:
    import trimesh

_GROUP = 2
"""Blocks of the occupancy grid along the edge of a piece of mesh: smaller ones cost more calls, larger ones more
queries after a change."""
_PIECE_VOXELS = _GROUP * BLOCK

RgbQuery = Callable[[Float[np.ndarray, "n 3"]], Float32[np.ndarray, "n 3"]]
"""World points [m] to colours in [0, 1]."""


@dataclass(frozen=True)
class Triangles:
    """Coloured triangles, counter-clockwise as seen from free space."""

    vertices_m: Float[np.ndarray, "v 3"]
    faces: Int64[np.ndarray, "f 3"]
    rgb: Float32[np.ndarray, "v 3"]
    """In [0, 1]."""


class MeshExtractor:
    """Marches cubes over the lattice cells that touch an occupied voxel, and remembers the result piece by piece."""

    def __init__(self, occupancy: DepthOccupancy) -> None:
        self._occupancy = occupancy
        self._resolution_m = 0.0
        self._pieces: dict[tuple[int, int, int], tuple[tuple[int, int], Triangles]] = {}
        """What the occupancy grid said of a part of space, and what that held then."""

    def extract(self, sdf: SdfQuery, rgb: RgbQuery, resolution_m: float, *, reuse: bool = False) -> Triangles:
        """The SDF's zero level where something was observed, in the world [m]; ``sdf`` may be in any unit, and
        ``resolution_m`` is the edge of a lattice cell [m]. Raises MapError if that is not positive.

        With ``reuse`` it keeps what the last call found, with the same resolution, in parts of space that no frame has
        touched since. Where kept and new parts meet, seams may open by as much as the field has changed.
        """
        if not 0.0 < resolution_m < math.inf:
            raise MapError(f"The mesh resolution is {resolution_m} m, but it must be positive; 0.05 is usual.")
        known = self._pieces if reuse and resolution_m == self._resolution_m else {}
        occupied = (self._occupancy.grid.state == OCCUPIED).transpose(2, 1, 0)
        margin = 1 + math.ceil(resolution_m / self._occupancy.config.voxel_m)
        self._pieces = {}
        for place, stamp in self._touched_places():
            low = np.array(place) * _PIECE_VOXELS - margin - self._occupancy.voxels.corner
            high = low + _PIECE_VOXELS + 2 * margin
            low, high = np.maximum(low, 0), np.maximum(high, 0)
            voxels = occupied[tuple(map(slice, low, high))]
            # Carving leaves no stamp, but fewer voxels.
            fingerprint = (stamp, int(np.count_nonzero(voxels)))
            before, triangles = known.get(place, (None, None))
            if triangles is None or before != fingerprint:
                inside = voxels, low + self._occupancy.voxels.corner
                triangles = self._triangles(sdf, rgb, inside, place, resolution_m)
            self._pieces[place] = fingerprint, triangles
        self._resolution_m = resolution_m
        parts = [triangles for _, triangles in self._pieces.values()]
        if not reuse:
            # The mesh of a large building takes as much memory again.
            self._pieces = {}
        return _joined(parts)

    def _touched_places(self) -> list[tuple[tuple[int, int, int], int]]:
        """Parts of space with hits in or next to them, by x, y, z index, and the last frame that hit them."""
        block, stamp = self._occupancy.blocks_with_hits()
        last: dict[tuple[int, int, int], int] = {}
        for (x, y, z), frame in zip((block // _GROUP).tolist(), stamp.tolist(), strict=True):
            last[x, y, z] = max(last.get((x, y, z), 0), frame)
        # A voxel on the rim supports faces of cells that belong to the next part.
        for x, y, z in list(last):
            for dx, dy, dz in np.ndindex(2, 2, 2):
                last.setdefault((x - dx, y - dy, z - dz), 0)
        return sorted(last.items())

    def _triangles(
        self, sdf: SdfQuery, rgb: RgbQuery, occupied: Cells, place: tuple[int, int, int], resolution_m: float
    ) -> Triangles:
        """Triangles of the lattice cells whose lowest corner lies in a part of space."""
        edge = self._occupancy.config.voxel_m
        bounds = (np.array([place, np.array(place) + 1]) * _PIECE_VOXELS - 0.5) * (edge / resolution_m)
        first, end = np.ceil(bounds - 1e-9).astype(np.int64)
        cells = active_cells(occupied, first, end, resolution_m / edge, REACH_VOXELS)
        vertices, faces = march(sdf, cells, first, resolution_m)
        observed = self._occupancy.near_occupied(vertices, REACH_VOXELS * edge)
        vertices, faces = remove_unreferenced(vertices, faces[observed[faces].all(axis=1)])
        return Triangles(vertices, faces, rgb(vertices))


def colored_mesh(triangles: Triangles) -> trimesh.Trimesh:
    """A mesh with vertex colours."""
    import trimesh  # No run waits for it before its first step.

    alpha = np.full((len(triangles.rgb), 1), 255, np.uint8)
    colors: UInt8[np.ndarray, "v 4"] = np.hstack((np.rint(triangles.rgb * 255.0).astype(np.uint8), alpha))
    return trimesh.Trimesh(triangles.vertices_m, triangles.faces, vertex_colors=colors, process=False)


def _joined(parts: list[Triangles]) -> Triangles:
    """All parts as one, equal vertices merged; takes them out of the list, so that memory holds few copies."""
    num_vertices, num_faces = sum(len(part.vertices_m) for part in parts), sum(len(part.faces) for part in parts)
    vertices, rgb = np.empty((num_vertices, 3)), np.empty((num_vertices, 3), np.float32)
    faces = np.empty((num_faces, 3), np.int64)
    parts.reverse()
    vertex = face = 0
    while parts:
        part = parts.pop()
        more = slice(vertex, vertex + len(part.vertices_m))
        vertices[more], rgb[more] = part.vertices_m, part.rgb
        np.add(part.faces, vertex, out=faces[face : face + len(part.faces)])
        vertex, face = more.stop, face + len(part.faces)
    kept, faces = merge_vertices(vertices, faces)
    return Triangles(vertices[kept], faces, rgb[kept])
