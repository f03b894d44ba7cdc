"""Submeshes: triangles of a scene that share one texture or colour."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float64, Integer, UInt8

from anm_mj.errors import SceneError
from anm_mj.scene.raster import areas


@dataclass(frozen=True)
class Submesh:
    """Triangles that share one material, in the world (z up, floor at z = 0) [m].

    Submeshes are unlit: the camera sees the texture times ``rgb``, or ``rgb`` alone. Raises SceneError if vertices are
    not finite, a face index is out of range, or a texture has no ``uv``.
    """

    name: str
    """Appears in file and geom names; need not be unique."""
    vertices_m: Float[np.ndarray, "v 3"]
    faces: Integer[np.ndarray, "f 3"]
    rgb: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Colour in 0..1; multiplies the texture."""
    uv: Float[np.ndarray, "v 2"] | None = None
    """Texture coordinates, u to the right and v up (v = 0 is the bottom row of the image); outside 0..1 they repeat."""
    texture: UInt8[np.ndarray, "h w 3"] | None = None
    """Image with row 0 at its top."""
    tiled: bool = False
    """Whether the texture holds a tile per triangle, so that it must keep its size
    (:mod:`anm_mj.scene.importing.bake_colours`)."""
    part: str = ""
    """The part of the source that it belongs to, such as a model and its link, outermost first, joined by "/"."""

    def __post_init__(self) -> None:
        if not np.isfinite(self.vertices_m).all():
            bad = int(np.count_nonzero(~np.isfinite(self.vertices_m).all(axis=1)))
            raise SceneError(
                f"Submesh {self.name!r} has {bad} vertices with NaN or infinite coordinates: repair the mesh."
            )
        if len(self.faces) and not 0 <= self.faces.min() <= self.faces.max() < len(self.vertices_m):
            raise SceneError(
                f"Submesh {self.name!r} has faces that name vertices {self.faces.min()} to {self.faces.max()}, "
                f"but there are {len(self.vertices_m)} vertices: repair the mesh."
            )
        if self.texture is not None and self.uv is None:
            raise SceneError(f"Submesh {self.name!r} has a texture but no texture coordinates.")


def without_degenerate_faces(submesh: Submesh) -> Submesh | None:
    """The same submesh without faces of no area and vertices of no face; None when no face is left."""
    # Faces below half a square micrometre neither show nor collide.
    has_area = areas(submesh.vertices_m[submesh.faces]) > 0.5e-12
    return only_faces(submesh, has_area) if has_area.any() else None


def only_faces(submesh: Submesh, kept: Bool[np.ndarray, " f"]) -> Submesh:
    """Some faces of a submesh, without the vertices of no face."""
    used, compact = np.unique(submesh.faces[kept], return_inverse=True)
    uv = None if submesh.uv is None else submesh.uv[used]
    faces = compact.reshape(-1, 3).astype(np.int32)
    return replace(submesh, vertices_m=submesh.vertices_m[used], faces=faces, uv=uv)


def triangles_of(submeshes: Sequence[Submesh]) -> Float[np.ndarray, "f 3 3"]:
    """Corners of the triangles of all submeshes, in order."""
    return np.concatenate([submesh.vertices_m[submesh.faces] for submesh in submeshes])


def middle_of(submeshes: Sequence[Submesh]) -> Float[np.ndarray, "3"]:
    """The middle of the bounding box of all triangles."""
    corners = triangles_of(submeshes).reshape(-1, 3)
    return (corners.min(axis=0) + corners.max(axis=0)) / 2.0


def is_within(part: str, others: Collection[str]) -> bool:
    """Whether a part is one of others, or belongs to one of them."""
    return bool(part) and any(part == other or part.startswith(f"{other}/") for other in others)


def merge_geometry(submeshes: list[Submesh]) -> tuple[Float[np.ndarray, "v 3"], Integer[np.ndarray, "f 3"]]:
    """Vertices and faces of all submeshes in one mesh, in order, without touching a vertex."""
    offsets = np.cumsum([0] + [len(submesh.vertices_m) for submesh in submeshes[:-1]])
    vertices = np.concatenate([submesh.vertices_m for submesh in submeshes])
    faces = np.concatenate([submesh.faces + offset for submesh, offset in zip(submeshes, offsets, strict=True)])
    return vertices, faces


def transformed(
    submesh: Submesh, rotation: Float64[np.ndarray, "3 3"], shift: Float64[np.ndarray, "3"] | None = None
) -> Submesh:
    """The submesh at ``rotation @ vertex + shift``; the matrix may scale too; where it mirrors, faces are reversed."""
    vertices = submesh.vertices_m @ rotation.T
    if shift is not None:
        vertices = vertices + shift
    faces = submesh.faces[:, ::-1] if np.linalg.det(rotation) < 0.0 else submesh.faces
    return replace(submesh, vertices_m=vertices, faces=faces)


def merge_alike(submeshes: list[Submesh], apart: Collection[str] = ()) -> list[Submesh]:
    """Submeshes of equal colour and texture as one, in order of first appearance.

    Those of parts in ``apart`` are joined only with others of their part; the others lose the names of their parts.

    Worlds of hundreds of small objects render and compile several times as fast, and the renderer takes at most a
    thousand textured materials.
    """
    groups: dict[tuple[object, ...], list[Submesh]] = {}
    for submesh in submeshes:
        own = next((part for part in apart if is_within(submesh.part, [part])), "")
        look = (submesh.rgb, None if submesh.texture is None else id(submesh.texture), own)
        groups.setdefault(look, []).append(replace(submesh, part=own))
    merged = []
    for first, *others in groups.values():
        if others:
            vertices, faces = merge_geometry([first, *others])
            uvs = [submesh.uv for submesh in (first, *others) if submesh.uv is not None]
            uv = None if first.texture is None else np.concatenate(uvs)
            first = replace(first, vertices_m=vertices, faces=faces, uv=uv)
        merged.append(first)
    return merged
