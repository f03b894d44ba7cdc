"""Geoms as the triangles that MuJoCo's renderer draws, so that an imported scene has the same depth to the pixel.

Spheres, ellipsoids, capsules and cylinders are drawn as unit shapes of ``numslices`` x ``numstacks`` facets
(``<quality>``; 28 x 16 by default) that are scaled to size. Textures are mapped by the unit shape's coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64, Int64

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True)
class Shape:
    """Triangles of a geom in its own frame."""

    vertices_m: Float64[np.ndarray, "v 3"]
    faces: Int64[np.ndarray, "f 3"]
    unit: Float64[np.ndarray, "v 3"]
    """Coordinates by which a texture is mapped: of the unit shape before scaling, or in metres."""
    texcoord: Float64[np.ndarray, "v 2"] | None = None
    """Texture coordinates of its own, v down."""
    repeats: bool = False
    """Whether ``texrepeat`` multiplies them, as on all but meshes."""

    def scaled(self, size: Float64[np.ndarray, "3"]) -> Shape:
        """A unit shape at its size [m]."""
        return replace(self, vertices_m=self.vertices_m * size)


def geom_shape(model: mujoco.MjModel, geom: int) -> Shape | None:
    """The triangles of a geom; None for an endless plane, which has none before it is cut, and for no geom's type."""
    import mujoco

    kinds = mujoco.mjtGeom
    kind, size = int(model.geom_type[geom]), half_lengths(model, geom)
    slices, stacks = int(model.vis.quality.numslices), int(model.vis.quality.numstacks)
    if kind in (kinds.mjGEOM_MESH, kinds.mjGEOM_SDF):
        return _mesh(model, int(model.geom_dataid[geom]))
    if kind == kinds.mjGEOM_HFIELD:
        return _height_field(model, int(model.geom_dataid[geom]))
    if kind == kinds.mjGEOM_PLANE:
        return rectangle(-size[:2], size[:2]) if size[:2].all() else None
    if kind == kinds.mjGEOM_BOX:
        return unit_box().scaled(size)
    if kind in (kinds.mjGEOM_SPHERE, kinds.mjGEOM_ELLIPSOID):
        return _unit_sphere(slices, stacks).scaled(size)
    if kind == kinds.mjGEOM_CYLINDER:
        return _joined([_tube(slices), _disk(slices, -1), _disk(slices, 1)]).scaled(size)
    return _capsule(slices, stacks, size) if kind == kinds.mjGEOM_CAPSULE else None


def half_lengths(model: mujoco.MjModel, geom: int) -> Float64[np.ndarray, "3"]:
    """Half lengths of a geom along its axes as the renderer has them; 0 along an endless plane [m]."""
    import mujoco

    size = np.asarray(model.geom_size[geom], dtype=np.float64)
    kind = int(model.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return np.full(3, size[0])
    return size[[0, 0, 1]] if kind in (mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_CAPSULE) else size


def num_triangles(model: mujoco.MjModel, geom: int) -> int:
    """About how many triangles :func:`geom_shape` makes, which is known before they are made."""
    import mujoco

    kinds = mujoco.mjtGeom
    kind, data = int(model.geom_type[geom]), int(model.geom_dataid[geom])
    slices, stacks = (max(1, int(number)) for number in (model.vis.quality.numslices, model.vis.quality.numstacks))
    if kind in (kinds.mjGEOM_MESH, kinds.mjGEOM_SDF):
        return int(model.mesh_facenum[data])
    if kind == kinds.mjGEOM_HFIELD:
        return 2 * int(model.hfield_nrow[data]) * int(model.hfield_ncol[data])
    if kind == kinds.mjGEOM_CYLINDER:
        return 4 * slices
    return 2 * slices * stacks if kind in (kinds.mjGEOM_SPHERE, kinds.mjGEOM_ELLIPSOID, kinds.mjGEOM_CAPSULE) else 12


def rectangle(low_m: Float64[np.ndarray, "2"], high_m: Float64[np.ndarray, "2"]) -> Shape:
    """A rectangle in the plane z = 0, facing along z."""
    (a, c), (b, d) = low_m, high_m
    vertices = np.array([[a, c, 0.0], [b, c, 0.0], [b, d, 0.0], [a, d, 0.0]])
    return Shape(vertices, np.array([[0, 1, 2], [0, 2, 3]]), vertices)


def _mesh(model: mujoco.MjModel, mesh: int) -> Shape:
    """A mesh; corners with their own texture coordinates become vertices of their own."""
    first, num = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    at, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    vertices = model.mesh_vert[at : at + count].astype(np.float64)
    faces = model.mesh_face[first : first + num].astype(np.int64)
    uv_at = int(model.mesh_texcoordadr[mesh])
    if uv_at < 0:
        return Shape(vertices, faces, vertices)
    coordinates = model.mesh_texcoord[uv_at : uv_at + int(model.mesh_texcoordnum[mesh])].astype(np.float64)
    corners = np.stack([faces.ravel(), model.mesh_facetexcoord[first : first + num].ravel()], axis=1)
    pairs, index = np.unique(corners, axis=0, return_inverse=True)
    own = vertices[pairs[:, 0]]
    return Shape(own, index.reshape(-1, 3).astype(np.int64), own, coordinates[pairs[:, 1]])


def _height_field(model: mujoco.MjModel, field: int) -> Shape:
    rows, cols = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    x_m, y_m, top_m, base_m = (float(value) for value in model.hfield_size[field])
    at = int(model.hfield_adr[field])
    height = model.hfield_data[at : at + rows * cols].reshape(rows, cols).astype(np.float64) * top_m
    x, y = np.meshgrid(np.linspace(-x_m, x_m, cols), np.linspace(-y_m, y_m, rows))
    surface = np.stack([x, y, height], axis=-1).reshape(-1, 3)
    below = surface * (1.0, 1.0, 0.0) - (0.0, 0.0, base_m)
    index = np.arange(rows * cols).reshape(rows, cols)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    # The renderer cuts each cell from its corner of least x and y to the opposite one.
    faces = [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
    rim = np.concatenate([index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0]])
    after = np.roll(rim, -1)
    lower = rows * cols
    faces.append(np.stack([rim + lower, after + lower, after], axis=1))
    faces.append(np.stack([rim + lower, after, rim], axis=1))
    corners = index[[0, 0, -1, -1], [0, -1, -1, 0]] + lower
    faces.append(corners[[[0, 2, 1], [0, 3, 2]]])
    vertices = np.concatenate([surface, below])
    return Shape(vertices, np.concatenate(faces).astype(np.int64), vertices)


def unit_box() -> Shape:
    """A box from -1 to 1 whose six faces have corners of their own, in the order +x, -x, +y, -y, +z, -z."""
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    vertices, texcoord = [], []
    for axis in range(3):
        for side in (1.0, -1.0):
            corners = np.empty((4, 3))
            corners[:, axis] = side
            # Seen from outside, the corners go round to the left.
            corners[:, (axis + 1) % 3], corners[:, (axis + 2) % 3] = side * square[:, 0], square[:, 1]
            vertices.append(corners)
            right, up = corners[:, 1 if axis == 0 else 0], corners[:, 1 if axis == 2 else 2]
            texcoord.append(np.stack([0.5 + 0.5 * right, 0.5 - 0.5 * up], axis=1))
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * i for i in range(6)])
    unit = np.concatenate(vertices)
    return Shape(unit, faces.astype(np.int64), unit, np.concatenate(texcoord), repeats=True)


def _unit_sphere(slices: int, stacks: int) -> Shape:
    half = max(1, stacks // 2)
    share = np.arange(-half, half + 1) / half
    return _turned(np.cos(np.pi / 2.0 * share), np.sin(np.pi / 2.0 * share), 0.5 - 0.5 * share, slices)


def _turned(
    radius: Float64[np.ndarray, " n"], z: Float64[np.ndarray, " n"], v: Float64[np.ndarray, " n"], slices: int
) -> Shape:
    """The surface of a profile, from its lower to its upper end, turned about z; u runs round."""
    # Vertices are double at the seam of u.
    azimuth = 2.0 * np.pi * (np.arange(slices + 1) % slices) / slices
    ring = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    shape = (len(z), slices + 1, 1)
    height = np.broadcast_to(z[:, None, None], shape)
    vertices = np.concatenate([radius[:, None, None] * ring, height], axis=2).reshape(-1, 3)
    u = np.broadcast_to(np.arange(slices + 1) / slices, shape[:2])
    texcoord = np.stack([u, np.broadcast_to(v[:, None], shape[:2])], axis=2).reshape(-1, 2)
    index = np.arange(len(vertices)).reshape(shape[:2])
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    lower, upper = (np.repeat(end > 1e-9, slices) for end in (radius[:-1], radius[1:]))
    # At a pole one of the two triangles has no area.
    faces = np.concatenate([np.stack([a, b, c], axis=1)[lower], np.stack([a, c, d], axis=1)[upper]])
    return Shape(vertices, faces, vertices, texcoord, repeats=True)


def _tube(slices: int) -> Shape:
    return _turned(np.ones(2), np.array([-1.0, 1.0]), np.array([1.0, 0.0]), slices)


def _disk(slices: int, side: int) -> Shape:
    """The end of a cylinder at z = ``side``, facing away from it."""
    flat = _turned(np.array([1.0, 0.0]), np.full(2, float(side)), np.zeros(2), slices)
    faces = flat.faces if side > 0 else flat.faces[:, ::-1]
    return replace(flat, faces=faces, texcoord=0.5 + 0.5 * flat.unit[:, :2])


def _capsule(slices: int, stacks: int, size: Float64[np.ndarray, "3"]) -> Shape:
    """A capsule along z: a tube of the size between two half spheres."""
    half = max(1, stacks // 2)
    share = np.arange(half + 1) / half
    v, radius, z = 1.0 - share, np.cos(np.pi / 2.0 * share), np.sin(np.pi / 2.0 * share)
    top, bottom = _turned(radius, z, v, slices), _turned(radius, -z, 1.0 - v, slices)
    bottom = replace(bottom, faces=bottom.faces[:, ::-1])
    ends = [
        replace(end, vertices_m=end.unit * size[0] + shift * size[2], unit=end.unit + shift)
        for end, shift in ((top, np.array([0.0, 0.0, 1.0])), (bottom, np.array([0.0, 0.0, -1.0])))
    ]
    return _joined([_tube(slices).scaled(size), *ends])


def _joined(pieces: list[Shape]) -> Shape:
    offsets = np.cumsum([0] + [len(piece.unit) for piece in pieces[:-1]])
    return Shape(
        np.concatenate([piece.vertices_m for piece in pieces]),
        np.concatenate([piece.faces + offset for piece, offset in zip(pieces, offsets, strict=True)]),
        np.concatenate([piece.unit for piece in pieces]),
        np.concatenate([piece.texcoord for piece in pieces if piece.texcoord is not None]),
        repeats=True,
    )
