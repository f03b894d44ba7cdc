import numpy as np
import trimesh

from anm_mj.scene.importing.bake_colours import bake_colours


def _bilinear(texture, uv):
    """What GL's linear filter shows at uv (v up), away from the border."""
    height, width = texture.shape[:2]
    x, y = uv[:, 0] * width - 0.5, (1.0 - uv[:, 1]) * height - 0.5
    col, row = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - col)[:, None], (y - row)[:, None]
    image = texture.astype(float)
    col1, row1 = np.minimum(col + 1, width - 1), np.minimum(row + 1, height - 1)
    top = image[row, col] * (1 - fx) + image[row, col1] * fx
    bottom = image[row1, col] * (1 - fx) + image[row1, col1] * fx
    return top * (1 - fy) + bottom * fy


def test_the_baked_texture_blends_the_corner_colours_over_every_face():
    mesh = trimesh.creation.icosphere(subdivisions=2)
    # Smooth over the sphere, so that the fourth texel of a tile stays within 0..255.
    vertex_rgb = np.round((mesh.vertices * 0.35 + 0.5) * 255.0).astype(np.uint8)
    (part,) = bake_colours("ball", mesh.vertices, mesh.faces, vertex_rgb[mesh.faces])
    assert part.uv is not None
    assert part.texture is not None

    weights = np.random.default_rng(1).dirichlet([1.0, 1.0, 1.0], size=len(part.faces))
    shown = _bilinear(part.texture, np.einsum("fc,fcd->fd", weights, part.uv[part.faces]))
    places = np.einsum("fc,fcd->fd", weights, part.vertices_m[part.faces])
    true = (places * 0.35 + 0.5) * 255.0
    assert np.abs(shown - true).max() < 2.0


def test_baking_keeps_every_triangle():
    mesh = trimesh.creation.icosphere(subdivisions=1)
    rgb = np.random.default_rng(0).integers(0, 255, (len(mesh.faces), 3), dtype=np.uint8)
    (part,) = bake_colours("ball", mesh.vertices, mesh.faces, np.repeat(rgb[:, None], 3, axis=1))
    ours = part.vertices_m[part.faces].reshape(len(part.faces), -1)
    theirs = mesh.vertices[mesh.faces].reshape(len(mesh.faces), -1)
    assert np.allclose(ours[np.lexsort(ours.T)], theirs[np.lexsort(theirs.T)])


def test_neighbours_in_space_are_near_in_the_atlas():
    mesh = trimesh.creation.box().subdivide().subdivide().subdivide()
    rgb = np.random.default_rng(0).integers(0, 255, (len(mesh.vertices), 3), dtype=np.uint8)
    (part,) = bake_colours("box", mesh.vertices, mesh.faces, rgb[mesh.faces])
    assert part.uv is not None
    centres, tiles = part.vertices_m[part.faces].mean(axis=1), part.uv[part.faces].mean(axis=1)
    step = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    jump = np.linalg.norm(np.diff(tiles, axis=0), axis=1)
    assert np.median(step) < 0.2
    assert np.median(jump) < 0.1


def test_one_colour_needs_no_texture():
    mesh = trimesh.creation.box()
    rgb = np.tile(np.array([[51, 102, 255]], dtype=np.uint8), (len(mesh.faces), 1))
    (part,) = bake_colours("box", mesh.vertices, mesh.faces, np.repeat(rgb[:, None], 3, axis=1))
    assert part.texture is None
    assert part.rgb == (0.2, 0.4, 1.0)
