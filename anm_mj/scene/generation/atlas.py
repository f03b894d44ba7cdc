"""Paints quads into one image per group: the material's pattern times the light that falls there.

Every quad gets a rectangle of texels of its own, with its corners at the centres of the rectangle's corner texels, so
that bilinear filtering shows exactly what was painted. One texel of margin keeps neighbours from bleeding in.
"""

import math

import numpy as np
from jaxtyping import Float64, Int64, UInt8

from anm_mj.scene.generation.quads import Quads
from anm_mj.scene.generation.voxel_light import VoxelLighting, to_srgb
from anm_mj.scene.submesh import Submesh

_LIGHT_SPACING_M = 0.14
"""Light is worked out for points this far apart, and interpolated between them."""
_COARSER = 1.6
"""Texels are this much larger than the materials ask for: a scene of forty rooms stays of a size to keep."""
_SHADES = 64
"""Values per colour channel: fewer make a smaller file."""
_MARGIN_PX = 1
_INSET_M = 0.012
"""Light is looked up at least this far inside a quad: its very edge often lies inside a neighbour."""
_TEXELS_TOGETHER = 1 << 19

_Pairs = Int64[np.ndarray, "n 2"]
"""One number along u and one along v for each quad."""
_Indices = Int64[np.ndarray, " k"]
_Numbers = Float64[np.ndarray, " k"]
Cut = Float64[np.ndarray, "k 3 2"]
"""Triangles that stand for a quad: corners as shares (s, t) of the quad's sides."""


def paint(name: str, surface: Quads, lighting: VoxelLighting, cuts: dict[int, Cut]) -> Submesh:
    """One textured submesh of a surface.

    ``cuts`` are, by index, the quads of which only some triangles are there, as of a floor with slanting sides.
    """
    size_px = _resolution(surface, np.array([material.texel_m for material in surface.materials]) * _COARSER)
    padded_px = size_px + 2 * _MARGIN_PX
    corner_px, (width, height) = pack(padded_px)
    image = np.zeros((height, width, 3), np.uint8)
    sizes, light = _light_on(surface, lighting)
    numbers = {material: number for number, material in enumerate(dict.fromkeys(surface.materials))}
    number_of = np.array([numbers[material] for material in surface.materials], np.int64)
    num_texels = int(padded_px.prod(axis=1).sum())
    # A part at a time: the halls of large buildings have tens of millions of texels.
    for first in range(0, num_texels, _TEXELS_TOGETHER):
        quad, col, row = _cells(padded_px, first, min(first + _TEXELS_TOGETHER, num_texels))
        s = np.clip((col - _MARGIN_PX) / (size_px[quad, 0] - 1), 0.0, 1.0)
        t = np.clip((row - _MARGIN_PX) / (size_px[quad, 1] - 1), 0.0, 1.0)
        colour, uv_m = np.zeros((len(quad), 3)), _bilinear(surface.uv_m[quad], s, t)
        for material, number in numbers.items():
            texels = number_of[quad] == number
            colour[texels] = material.colour(uv_m[texels])
        # sRGB by the plain power law, near enough for paint.
        colour = to_srgb(colour**2.2 * _between(sizes, light, quad, s, t)[:, None])
        shade = np.rint(colour * (_SHADES - 1)) * (255.0 / (_SHADES - 1))
        image[corner_px[quad, 1] + row, corner_px[quad, 0] + col] = np.rint(shade).astype(np.uint8)
    return _submesh(name, surface, corner_px, size_px, image, cuts)


def points_on(surface: Quads, spacing_m: float) -> Float64[np.ndarray, "n 3"]:
    """Points all over a surface, no farther apart than the spacing [m]."""
    sizes, owner, col, row = _grids(surface, spacing_m)
    return _bilinear(surface.corners_m[owner], col / (sizes[owner, 0] - 1), row / (sizes[owner, 1] - 1))


def pack(sizes_px: _Pairs) -> tuple[_Pairs, tuple[int, int]]:
    """Where to put rectangles (width, height) so that none overlap, and the width and height of the whole.

    Rows of falling height, each filled from the left.
    """
    area = int(sizes_px.prod(axis=1).sum())
    width = max(int(sizes_px[:, 0].max()), 1 << math.ceil(math.log2(math.sqrt(area))))
    corners = np.zeros_like(sizes_px)
    x = y = row_height = 0
    for index in np.lexsort((-sizes_px[:, 0], -sizes_px[:, 1])):
        w, h = sizes_px[index]
        if x + w > width:
            x, y, row_height = 0, y + row_height, 0
        corners[index] = x, y
        x, row_height = x + int(w), max(row_height, int(h))
    return corners, (width, y + row_height)


def _resolution(surface: Quads, spacing_m: _Numbers) -> _Pairs:
    """Number of samples along u and v, at least two, no farther apart than the spacing."""
    p = surface.corners_m
    u = np.maximum(np.linalg.norm(p[:, 1] - p[:, 0], axis=1), np.linalg.norm(p[:, 2] - p[:, 3], axis=1))
    v = np.maximum(np.linalg.norm(p[:, 3] - p[:, 0], axis=1), np.linalg.norm(p[:, 2] - p[:, 1], axis=1))
    # A thousandth off, so that rounding does not add a sample to a length that divides evenly.
    return np.ceil(np.stack([u, v], axis=1) / spacing_m[:, None] - 1e-3).astype(np.int64).clip(1) + 1


def _grids(surface: Quads, spacing_m: float) -> tuple[_Pairs, _Indices, _Indices, _Indices]:
    """Sizes of a grid of points on each quad, and the quad, column and row of every point."""
    sizes = _resolution(surface, np.full(len(surface.corners_m), spacing_m))
    return sizes, *_cells(sizes, 0, int(sizes.prod(axis=1).sum()))


def _cells(sizes: _Pairs, first: int, last: int) -> tuple[_Indices, _Indices, _Indices]:
    """Rectangle, column and row of the cells ``first`` to ``last`` (exclusive) of all rectangles."""
    ends = np.cumsum(sizes.prod(axis=1))
    cell = np.arange(first, last)
    quad = np.searchsorted(ends, cell, side="right")
    row, col = np.divmod(cell - (ends - sizes.prod(axis=1))[quad], sizes[quad, 0])
    return quad, col, row


def _bilinear(corners: Float64[np.ndarray, "k 4 d"], s: _Numbers, t: _Numbers) -> Float64[np.ndarray, "k d"]:
    weights = (1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t
    a, b, c, d = (weight[:, None] * corners[:, index] for index, weight in enumerate(weights))
    return a + b + c + d


def _light_on(surface: Quads, lighting: VoxelLighting) -> tuple[_Pairs, _Numbers]:
    """Light on a coarse grid of points on each quad: the sizes of the grids, and the light of all, one by one."""
    sizes, owner, col, row = _grids(surface, _LIGHT_SPACING_M)
    shares = []
    for axis, corner, cell in ((0, 1, col), (1, 3, row)):
        edge = np.linalg.norm(surface.corners_m[:, corner] - surface.corners_m[:, 0], axis=1)
        inset = np.clip(_INSET_M / np.maximum(edge, 1e-6), 0.0, 0.3)[owner]
        shares.append(np.clip(cell / (sizes[owner, axis] - 1), inset, 1 - inset))
    points = _bilinear(surface.corners_m[owner], *shares)
    light = lighting.falling_on(points, surface.normals[owner])
    light[np.array([material.glows for material in surface.materials])[owner]] = 1.0
    return sizes, light


def _between(sizes: _Pairs, light: Float64[np.ndarray, " m"], quad: _Indices, s: _Numbers, t: _Numbers) -> _Numbers:
    """Light at places on quads, between the points of their grids."""
    first = (np.cumsum(sizes.prod(axis=1)) - sizes.prod(axis=1))[quad]
    width = sizes[quad, 0]
    x, y = s * (width - 1), t * (sizes[quad, 1] - 1)
    i, j = np.minimum(x.astype(np.int64), width - 2), np.minimum(y.astype(np.int64), sizes[quad, 1] - 2)
    base = first + j * width + i
    around = np.stack([light[base], light[base + 1], light[base + width + 1], light[base + width]], axis=1)
    return _bilinear(around[:, :, None], x - i, y - j)[:, 0]


def _submesh(
    name: str,
    surface: Quads,
    corner_px: _Pairs,
    size_px: _Pairs,
    image: UInt8[np.ndarray, "h w 3"],
    cuts: dict[int, Cut],
) -> Submesh:
    ends = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    whole = np.array([k for k in range(len(corner_px)) if k not in cuts], dtype=np.int64)
    texels = [(corner_px[whole, None] + _MARGIN_PX + 0.5 + ends * (size_px[whole, None] - 1)).reshape(-1, 2)]
    vertices = [surface.corners_m[whole].reshape(-1, 3)]
    faces = [(4 * np.arange(len(whole))[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)]
    for k, triangles in cuts.items():
        shares = triangles.reshape(-1, 2)
        faces.append(sum(len(block) for block in vertices) + np.arange(len(shares)).reshape(-1, 3))
        texels.append(corner_px[k] + _MARGIN_PX + 0.5 + shares * (size_px[k] - 1))
        corners = np.broadcast_to(surface.corners_m[k], (len(shares), 4, 3))
        vertices.append(_bilinear(corners, shares[:, 0], shares[:, 1]))
    uv = np.concatenate(texels) / (image.shape[1], image.shape[0])
    return Submesh(
        name,
        np.concatenate(vertices).astype(np.float32),
        np.concatenate(faces).astype(np.int32),
        uv=np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=-1).astype(np.float32),
        texture=image,
    )
