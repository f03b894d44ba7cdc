"""Lamps, plants, pictures, rugs and screens; each stands about the origin or hangs on a wall along y = 0."""

import math

import numpy as np

from anm_mj.scene.generation.quads import Material, Parts, Quads, box, cushion, grid_quads, join, joined, lathe
from anm_mj.scene.generation.textures import Colour, glow, plain, rgb, rug, spots

_DARK = plain(rgb("2b2d31"))
_LEAF_GREENS = [plain(rgb(code), 0.2) for code in ("3f7d4e", "55925a", "2f6b45")]
_RUG_THICKNESS_M = 0.008


def rug_on_floor(size_m: tuple[float, float], ground: Colour, border: Colour, motif: Colour) -> Quads:
    """A carpet, low enough to drive over."""
    x, y = size_m[0] / 2, size_m[1] / 2
    return box((-x, -y, 0.0), (x, y, _RUG_THICKNESS_M), rug(ground, border, motif, size_m), "-z")


def table_lamp(shade: Colour, foot: Material) -> Quads:
    """A bedside lamp."""
    base = [(0.07, 0.0), (0.075, 0.03), (0.035, 0.09), (0.05, 0.14), (0.015, 0.2), (0.015, 0.24)]
    return join(lathe(base, foot, 12), lathe([(0.0, 0.22), (0.12, 0.22), (0.075, 0.38), (0.0, 0.38)], glow(shade), 14))


@joined
def plant(height_m: float, num_leaves: int, pot: Material, seed: int) -> Parts:
    """A pot with long arching leaves."""
    rng = np.random.default_rng(seed)
    size = 0.25 * height_m + 0.04
    rim = 0.36 * size
    soil = spots(rgb("4a3728"), rgb("33261c"), scale=60.0)
    outside = [(0.7 * rim, 0.0), (rim, 0.8 * size), (1.08 * rim, 0.8 * size), (1.08 * rim, size), (0.9 * rim, size)]
    yield lathe(outside, pot, 14)
    yield lathe([(0.9 * rim, size), (0.9 * rim, 0.92 * size), (0.0, 0.92 * size)], soil, 14)
    for k in range(num_leaves):
        angle = 2.399963 * k + rng.uniform(-0.3, 0.3)
        length, lean = (height_m - size) * rng.uniform(0.75, 1.15), rng.uniform(0.15, 0.7)
        leaf = _leaf(length, 0.085 * height_m + 0.02, lean, _LEAF_GREENS[rng.integers(len(_LEAF_GREENS))])
        yield leaf.placed(0.3 * rim * math.cos(angle), 0.3 * rim * math.sin(angle), math.degrees(angle), 0.9 * size)


def _leaf(length_m: float, width_m: float, lean_rad: float, material: Material) -> Quads:
    """A leaf that rises from the origin and bends over towards +x; its two faces meet along its edge."""
    num = 5
    t = np.linspace(0.0, 1.0, num)
    angle = 0.12 + lean_rad * t * 1.3
    step = length_m / (num - 1)
    x = np.concatenate([[0.0], np.cumsum(step * np.sin(angle[:-1]))])
    z = np.concatenate([[0.0], np.cumsum(step * np.cos(angle[:-1]))])
    half = width_m / 2 * np.sin(math.pi * np.clip(0.08 + 0.92 * t, 0.0, 1.0)) ** 0.7 + 0.001
    thick = 0.008 * np.sin(math.pi * np.clip(0.1 + 0.88 * t, 0.0, 1.0))
    middle = np.stack([x, np.zeros(num), z], axis=-1)
    bulge = np.stack([-np.cos(angle), np.zeros(num), np.sin(angle)], axis=-1) * thick[:, None]
    side = np.array([0.0, 1.0, 0.0]) * half[:, None]
    points = np.stack([middle - side, middle + bulge, middle + side, middle - bulge, middle - side], axis=1)
    across = np.linspace(0.0, width_m, points.shape[1])
    uv = np.stack(np.broadcast_arrays(across[None, :], (t * length_m)[:, None]), axis=-1)
    return grid_quads(points, uv, material)


def picture(width_m: float, height_m: float, z_m: float, image: Material, frame: Material) -> Quads:
    """A framed picture on a wall along y = 0, facing -y; z is its lower edge."""
    x, bar = width_m / 2, 0.03
    canvas = box((0.0, -0.012, 0.0), (width_m, 0.0, height_m), image, "-x +x +y -z +z").placed(-x, 0.0, 0.0, z_m)
    return join(
        canvas,
        box((-x - bar, -0.025, z_m - bar), (x + bar, 0.0, z_m), frame, "+y"),
        box((-x - bar, -0.025, z_m + height_m), (x + bar, 0.0, z_m + height_m + bar), frame, "+y"),
        box((-x - bar, -0.025, z_m), (-x, 0.0, z_m + height_m), frame, "+y -z +z"),
        box((x, -0.025, z_m), (x + bar, 0.0, z_m + height_m), frame, "+y -z +z"),
    )


def television(width_m: float, screen: Material) -> Quads:
    """A flat screen on a foot; it faces -y."""
    x, height = width_m / 2, 0.57 * width_m
    face = box((0.0, -0.021, 0.0), (width_m - 0.03, -0.02, height - 0.03), screen, "+y -x +x -z +z")
    return join(
        box((-0.18, -0.1, 0.0), (0.18, 0.1, 0.015), _DARK, "-z"),
        box((-0.03, 0.0, 0.015), (0.03, 0.02, 0.08), _DARK, "-z +z"),
        box((-x, -0.02, 0.07), (x, 0.025, 0.07 + height), _DARK),
        face.placed(-x + 0.015, 0.0, 0.0, 0.085),
    )


def monitor(screen: Material) -> Quads:
    """A computer screen with keyboard and mouse before it; it faces -y."""
    keys = plain(rgb("d7d9dc"))
    return join(
        television(0.6, screen).placed(0.0, -0.18),
        box((-0.22, -0.52, 0.0), (0.22, -0.38, 0.018), keys, "-z"),
        cushion((0.28, -0.5, -0.01), (0.34, -0.4, 0.03), 0.018, keys, "-z", segments=1),
    )
