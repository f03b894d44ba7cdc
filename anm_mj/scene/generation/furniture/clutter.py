"""Small things that lie about on tables, shelves and the floor; each stands about the origin."""

import math

import numpy as np

from anm_mj.scene.generation.quads import Material, Parts, Quads, ball, box, cushion, join, joined, lathe, strut
from anm_mj.scene.generation.textures import Colour, plain, rgb, wood

_DARK = plain(rgb("2b2d31"))
_STEM = plain(rgb("3f7d4e"), 0.2)


@joined
def stack_of_books(num: int, seed: int) -> Parts:
    """Books that lie on one another, each turned a little."""
    rng = np.random.default_rng(seed)
    z = 0.0
    for _ in range(num):
        thick = rng.uniform(0.02, 0.04)
        colour = rgb(("8c2f39", "2f5d8c", "d9a441", "3b6b4f", "e4ddd0")[rng.integers(5)])
        book = box((-0.12, -0.085, 0.0), (0.12, 0.085, thick), plain(colour), "-z")
        yield book.placed(0.0, 0.0, rng.uniform(-20, 20), z)
        z += thick


def cup(colour: Colour) -> Quads:
    """A mug."""
    profile = [(0.032, 0.0), (0.04, 0.02), (0.04, 0.095), (0.034, 0.095), (0.03, 0.02), (0.0, 0.02)]
    return lathe(profile, plain(colour), 10)


def bottle(colour: Colour) -> Quads:
    """A bottle 0.3 m high."""
    profile = [(0.037, 0.0), (0.037, 0.18), (0.014, 0.23), (0.014, 0.29), (0.0, 0.29)]
    return lathe(profile, plain(colour), 10)


def bowl_of_fruit(bowl: Material) -> Quads:
    """A bowl with oranges and apples."""
    dish = lathe([(0.05, 0.0), (0.13, 0.05), (0.16, 0.09), (0.15, 0.09), (0.12, 0.055), (0.0, 0.02)], bowl, 14)
    places = [(0.05, 0.03, 0.04), (-0.06, 0.02, 0.04), (0.0, -0.06, 0.04), (0.01, 0.01, 0.09)]
    fruits = [ball(0.04, plain(rgb(code), 0.1), 8) for code in ("e8862e", "c9302c", "e0b53a", "8fb339")]
    return join(dish, *(fruit.placed(x, y, 0.0, z) for fruit, (x, y, z) in zip(fruits, places, strict=True)))


@joined
def vase(colour: Colour, seed: int) -> Parts:
    """A vase with a few stems and blossoms."""
    rng = np.random.default_rng(seed)
    body = [(0.04, 0.0), (0.065, 0.06), (0.06, 0.12), (0.03, 0.19), (0.038, 0.22), (0.0, 0.2)]
    yield lathe(body, plain(colour), 12)
    blossoms = [plain(rgb(code), 0.1) for code in ("e5659d", "f2c14e", "f4f1de")]
    for k in range(5):
        angle = 1.26 * k
        tip = (0.11 * math.cos(angle), 0.11 * math.sin(angle), rng.uniform(0.36, 0.46))
        yield strut((0.0, 0.0, 0.19), tip, 0.004, _STEM, 4)
        yield ball(0.03, blossoms[k % 3], 6, 0.8).placed(tip[0], tip[1], 0.0, tip[2] - 0.01)


def teddy(colour: Colour) -> Quads:
    """A sitting bear that faces -y."""
    fur, light = plain(colour, 0.15), plain(rgb("e6cfa8"), 0.1)
    return join(
        ball(0.11, fur, 12, 1.15),
        ball(0.085, fur, 12).placed(0.0, -0.02, 0.0, 0.22),
        ball(0.035, light, 8).placed(0.0, -0.1, 0.0, 0.255),
        *(ball(0.032, fur, 8).placed(x, 0.0, 0.0, 0.36) for x in (-0.06, 0.06)),
        *(strut((x, -0.05, 0.05), (1.5 * x, -0.2, 0.045), 0.042, fur, 8) for x in (-0.07, 0.07)),
        *(strut((x, -0.02, 0.18), (1.7 * x, -0.1, 0.1), 0.032, fur, 8) for x in (-0.09, 0.09)),
    )


@joined
def toy_car(colour: Colour) -> Parts:
    """A toy car 0.24 m long."""
    yield cushion((-0.065, -0.12, 0.025), (0.065, 0.12, 0.085), 0.02, plain(colour), segments=1)
    yield cushion((-0.052, -0.05, 0.07), (0.052, 0.08, 0.13), 0.02, plain(rgb("b9d0da")), "-z", segments=1)
    for x in (-0.06, 0.06):
        for y in (-0.07, 0.07):
            yield strut((x, y, 0.03), (x + math.copysign(0.02, x), y, 0.03), 0.03, _DARK, 10)


def carton(width_m: float, depth_m: float, height_m: float) -> Quads:
    """A cardboard box with a strip of tape."""
    board, tape = wood(rgb("b98d5c"), 0.08), plain(rgb("d8c49a"))
    x, y = width_m / 2, depth_m / 2
    return join(
        box((-x, -y, 0.0), (x, y, height_m), board, "-z"),
        box((-0.025, -y - 0.001, 0.6 * height_m), (0.025, y + 0.001, height_m + 0.001), tape, "-z"),
    )
