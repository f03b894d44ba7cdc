"""Colours per vertex or face as a texture, because MuJoCo's meshes carry none.

Each triangle gets a tile of 2x2 texels that holds its corner colours c0, c1, c2 and c1 + c2 - c0. With texture
coordinates at the texels' centres, the bilinear filter between them is exactly the barycentric blend of the corners.
Triangles are laid out along a Morton curve through space and their tiles along a Morton curve through the atlas, so
that neighbours in space are neighbours in the texture and the coarser levels the GPU makes of it still look right.
"""

import numpy as np
from jaxtyping import Float, Int64, Integer, UInt8

from anm_mj.scene.submesh import Submesh

_MAX_SIDE_PX = 4096
"""Largest texture that every GL offers; four million triangles fit."""

_Vertices = Float[np.ndarray, "v 3"]
_Faces = Integer[np.ndarray, "f 3"]
_CornerRgb = UInt8[np.ndarray, "f 3 3"]


def bake_colours(name: str, vertices_m: _Vertices, faces: _Faces, corner_rgb: _CornerRgb) -> list[Submesh]:
    """Submeshes that show the colours given for the three corners of every face, blended over the face.

    A mesh of one colour becomes one submesh without a texture; one with more than four million triangles is split.
    """
    if (corner_rgb == corner_rgb[:1, :1]).all():
        red, green, blue = (float(value) / 255.0 for value in corner_rgb[0, 0])
        return [Submesh(name, vertices_m, faces, (red, green, blue))]
    order = np.argsort(_morton_of_centres(vertices_m[faces].mean(axis=1)), kind="stable")
    per_atlas = (_MAX_SIDE_PX // 2) ** 2
    return [
        _bake_atlas(name, vertices_m, faces[chunk], corner_rgb[chunk])
        for chunk in (order[first : first + per_atlas] for first in range(0, len(order), per_atlas))
    ]


def _bake_atlas(name: str, vertices_m: _Vertices, faces: _Faces, corner_rgb: _CornerRgb) -> Submesh:
    """One submesh with one atlas; faces come in Morton order."""
    tiles = 1
    while tiles * tiles < len(faces):
        tiles *= 2
    code = np.arange(len(faces), dtype=np.int64)
    # Upper left texel of each tile.
    col, row = 2 * _every_other_bit(code), 2 * _every_other_bit(code >> 1)
    atlas = np.zeros((2 * tiles, 2 * tiles, 3), dtype=np.uint8)
    c0, c1, c2 = (corner_rgb[:, corner].astype(np.int16) for corner in range(3))
    atlas[row, col] = c0
    atlas[row, col + 1] = c1
    atlas[row + 1, col] = c2
    atlas[row + 1, col + 1] = np.clip(c1 + c2 - c0, 0, 255)
    uv = np.empty((len(faces), 3, 2))
    for corner, (right, down) in enumerate(((0, 0), (1, 0), (0, 1))):
        uv[:, corner, 0] = (col + right + 0.5) / (2 * tiles)
        uv[:, corner, 1] = 1.0 - (row + down + 0.5) / (2 * tiles)
    return Submesh(
        name,
        vertices_m[faces.ravel()],
        np.arange(3 * len(faces), dtype=np.int32).reshape(-1, 3),
        uv=uv.reshape(-1, 2),
        texture=atlas,
        tiled=True,
    )


def _morton_of_centres(points_m: Float[np.ndarray, "n 3"]) -> Int64[np.ndarray, " n"]:
    """Place of each point along a Morton curve through the points' bounding cube (2048 steps a side)."""
    low = points_m.min(axis=0)
    side = max(float((points_m.max(axis=0) - low).max()), 1e-12)
    steps = np.minimum((points_m - low) / side * 2048.0, 2047.0).astype(np.int64)
    code = np.zeros(len(points_m), dtype=np.int64)
    for bit in range(11):
        for axis in range(3):
            code |= ((steps[:, axis] >> bit) & 1) << (3 * bit + axis)
    return code


def _every_other_bit(code: Int64[np.ndarray, " n"]) -> Int64[np.ndarray, " n"]:
    packed = np.zeros_like(code)
    for bit in range(16):
        packed |= ((code >> (2 * bit)) & 1) << bit
    return packed
