"""Furniture catalogue: kitchens and bathrooms. Each function draws one piece of a room's style, its sizes by chance."""

import numpy as np

from anm_mj.scene.generation.furniture import clutter
from anm_mj.scene.generation.piece import GAP_M, Design, Piece, against_wall, on_wall
from anm_mj.scene.generation.quads import Material, Parts, Quads, box, cushion, cylinder, join, joined, lathe, strut
from anm_mj.scene.generation.room_style import RoomStyle
from anm_mj.scene.generation.textures import glow, plain, rgb, stone, tiles

STEEL = plain(rgb("b9bec4"))
_BLACK = plain(rgb("23262b"))
PORCELAIN = plain(rgb("f3f4f2"), 0.005)


@joined
def counter(width_m: float, front: Material, top: Material, oven_at_m: float | None = None) -> Parts:
    """Base units 0.6 m deep and 0.9 m high, with a hob and an oven about ``oven_at_m`` along x."""
    x, depth = width_m / 2, 0.6
    yield box((-x, -depth + 0.06, 0.0), (x, 0.0, 0.1), _BLACK, "-z +y +z")
    yield box((-x, -depth + 0.02, 0.1), (x, 0.0, 0.86), front, "+y +z")
    yield box((-x, -depth - 0.01, 0.86), (x, 0.0, 0.9), top, "+y")
    num_units = max(1, round(width_m / 0.6))
    share = width_m / num_units
    for k in range(num_units):
        left, right = -x + k * share, -x + k * share + share
        is_oven = oven_at_m is not None and left <= oven_at_m < right
        panel = _BLACK if is_oven else front
        yield box((left + 0.004, -depth, 0.11), (right - 0.004, -depth + 0.02, 0.85), panel, "+y")
        yield box((left + 0.12, -depth - 0.03, 0.77), (right - 0.12, -depth, 0.785), STEEL, "+y")
        if is_oven:
            yield box((left + 0.02, -0.53, 0.9), (right - 0.02, -0.08, 0.906), _BLACK, "-z")
            for px, py in ((0.28, -0.42), (0.72, -0.42), (0.28, -0.19), (0.72, -0.19)):
                yield cylinder(0.075, 0.906, 0.909, plain(rgb("4a4d52")), 12).placed(left + px * share, py)


def sink() -> Quads:
    """A basin that lies on a worktop at z = 0, with a tap."""
    rim, wall = 0.012, 0.02
    x, y = 0.22, 0.16
    return join(
        box((-x - wall, -y - wall - 0.28, 0.0), (x + wall, y + wall - 0.28, rim), STEEL, "-z"),
        box((-x, -y - 0.28, rim), (x, y - 0.28, rim + 0.002), plain(rgb("7f858c")), "-z"),
        cylinder(0.018, 0.0, 0.22, STEEL, 8).placed(0.0, -0.07),
        strut((0.0, -0.07, 0.21), (0.0, -0.24, 0.24), 0.012, STEEL),
    )


@joined
def _wall_units(width_m: float, front: Material) -> Parts:
    """Upper cabinets 0.34 m deep, from 1.45 to 2.15 m."""
    x, depth, low, high = width_m / 2, 0.34, 1.45, 1.45 + 0.7
    yield box((-x, -depth + 0.02, low), (x, 0.0, high), front, "+y")
    num_doors = max(1, round(width_m / 0.45))
    share = width_m / num_doors
    for k in range(num_doors):
        left = -x + k * share
        middle = left + share / 2
        yield box((left + 0.004, -depth, low + 0.004), (left + share - 0.004, -depth + 0.02, high - 0.004), front, "+y")
        yield box((middle - 0.06, -depth - 0.02, low + 0.04), (middle + 0.06, -depth, low + 0.055), STEEL, "+y")


def _fridge(body: Material) -> Quads:
    """A fridge-freezer 0.6 m wide and 1.8 m high."""
    return join(
        box((-0.3, -0.6, 0.0), (0.3, 0.0, 1.8), body, "-z +y"),
        cushion((-0.3, -0.66, 0.03), (0.3, -0.6, 0.62), 0.015, body, "+y", segments=1),
        cushion((-0.3, -0.66, 0.64), (0.3, -0.6, 1.79), 0.015, body, "+y", segments=1),
        box((0.22, -0.69, 0.4), (0.24, -0.66, 0.58), STEEL, "+y"),
        box((0.22, -0.69, 0.7), (0.24, -0.66, 1.1), STEEL, "+y"),
    )


def kitchen_counter(s: RoomStyle, rng: np.random.Generator, width_m: float) -> Design:
    total, x = width_m + 0.65, -0.325
    solids = ((-total / 2, -0.65, total / 2 - 0.62, 0.0), (total / 2 - 0.64, -0.71, total / 2, 0.0))
    yield Piece("kitchen counter", "wall", solids, 0.8, 1.8, GAP_M)
    top = stone(rgb("e4ded2"), rgb("8f8578"))
    yield counter(width_m, s.paint, top, oven_at_m=-width_m / 4).placed(x)
    yield sink().placed(x + width_m / 4, 0.0, 0.0, 0.9)
    yield _wall_units(0.45 * width_m, s.paint).placed(x - 0.25 * width_m)
    yield _fridge(plain(rgb("dfe3e6"))).placed(total / 2 - 0.31)
    yield clutter.bottle(s.colours[2]).placed(x - width_m / 2 + 0.12, -0.15, 0.0, 0.9)
    yield clutter.bottle(s.colours[7]).placed(x - width_m / 2 + 0.22, -0.12, 0.0, 0.9)
    yield clutter.cup(s.colours[3]).placed(x + width_m / 2 - 0.2, -0.3, 0.0, 0.9)
    yield clutter.bowl_of_fruit(plain(s.colours[0])).placed(x, -0.3, 0.0, 0.9)


def worktop(s: RoomStyle, rng: np.random.Generator, width_m: float) -> Design:
    yield Piece("worktop", "wall", ((-width_m / 2, -0.65, width_m / 2, 0.0),), 0.7, 0.9, GAP_M)
    yield counter(width_m, s.paint, stone(rgb("e4ded2"), rgb("8f8578")), oven_at_m=-width_m / 4)
    yield sink().placed(width_m / 4, 0.0, 0.0, 0.9)
    yield clutter.bottle(s.colours[2]).placed(-width_m / 2 + 0.12, -0.15, 0.0, 0.9)
    yield clutter.cup(s.colours[3]).placed(0.0, -0.3, 0.0, 0.9)


def bathtub(s: RoomStyle, rng: np.random.Generator) -> Design:
    apron = tiles(s.colours[0], s.colours[0], 0.1, rgb("e9f2f4"))
    width = float(rng.uniform(1.5, 1.75))
    yield against_wall("bathtub", width, 0.76, 0.8, 0.5)
    # Hollow, and walled in on its front.
    x, y, rim, high, bottom, thin = (width - 0.01) / 2, -0.74, 0.07, 0.56, 0.2, 0.001
    (x0, y0), (x1, y1) = (-x + rim, y + rim), (x - rim, -rim)
    for low_m, high_m, skip in (
        ((x0, y0, bottom - 0.01), (x1, y1, bottom), "-x +x -y +y -z"),
        ((x0 - thin, y0, bottom), (x0, y1, high), "-x -y +y -z +z"),
        ((x1, y0, bottom), (x1 + thin, y1, high), "+x -y +y -z +z"),
        ((x0, y0 - thin, bottom), (x1, y0, high), "-y -x +x -z +z"),
        ((x0, y1, bottom), (x1, y1 + thin, high), "+y -x +x -z +z"),
        ((-x, y, high - 0.03), (x, y0, high), "+y -x +x"),
        ((-x, -rim, high - 0.03), (x, 0.0, high), "-y +y -z -x +x"),
        ((-x, y0, high - 0.03), (x0, -rim, high), "-y +y -z -x +x"),
        ((x1, y0, high - 0.03), (x, -rim, high), "-y +y -z -x +x"),
    ):
        yield box(low_m, high_m, PORCELAIN, skip)
    yield box((-x, y + 0.02, 0.0), (x, y + 0.03, high - 0.03), apron, "-z +z +y -x +x")
    yield strut((x - 0.03, y / 2, 0.75), (x - 0.2, y / 2, 0.72), 0.018, STEEL)
    for x in (-width / 2 + 0.01, width / 2 - 0.01):
        yield box((x - 0.01, -0.72, 0.0), (x + 0.01, 0.0, 0.53), apron, "-z")


def toilet(s: RoomStyle, rng: np.random.Generator) -> Design:
    yield against_wall("toilet", 0.46, 0.66, 0.82, 0.5)
    bowl = [(0.11, 0.0), (0.12, 0.1), (0.17, 0.3), (0.2, 0.38), (0.21, 0.41), (0.2, 0.43), (0.0, 0.44)]
    yield lathe(bowl, PORCELAIN, 16).placed(0.0, -0.42)
    yield box((-0.1, -0.35, 0.0), (0.1, -0.05, 0.36), PORCELAIN, "-z +z")
    yield cushion((-0.2, -0.2, 0.36), (0.2, 0.0, 0.82), 0.025, PORCELAIN, "+y", segments=1)
    yield box((-0.03, -0.12, 0.82), (0.03, -0.07, 0.83), STEEL, "-z")


def basin(s: RoomStyle, rng: np.random.Generator) -> Design:
    yield against_wall("basin", 0.74, 0.48, 1.9, 0.6)
    yield box((-0.35, -0.43, 0.1), (0.35, 0.0, 0.78), s.paint, "+y")
    for x in (-0.34, 0.01):
        yield box((x, -0.45, 0.12), (x + 0.33, -0.43, 0.76), s.paint, "+y")
    for x in (-0.04, 0.025):
        yield box((x, -0.47, 0.5), (x + 0.015, -0.45, 0.62), STEEL, "+y")
    yield box((-0.36, -0.46, 0.78), (0.36, 0.0, 0.82), plain(rgb("e8e2d6")), "+y")
    bowl = [(0.08, 0.0), (0.17, 0.05), (0.19, 0.1), (0.17, 0.1), (0.1, 0.03), (0.0, 0.02)]
    yield lathe(bowl, PORCELAIN, 16).placed(0.0, -0.24, 0.0, 0.82)
    yield cylinder(0.014, 0.82, 1.02, STEEL, 8).placed(0.0, -0.05)
    yield strut((0.0, -0.05, 1.01), (0.0, -0.17, 1.0), 0.011, STEEL)
    yield box((-0.3, -0.02, 1.15), (0.3, 0.0, 1.85), plain(rgb("b9d0da"), 0.08), "+y")
    yield clutter.bottle(s.colours[4]).placed(-0.25, -0.12, 0.0, 0.82)
    yield clutter.cup(rgb("f4f1de")).placed(0.24, -0.12, 0.0, 0.82)


def washing_machine(s: RoomStyle, rng: np.random.Generator) -> Design:
    yield against_wall("washing machine", 0.6, 0.6, 0.85, 0.6)
    yield cushion((-0.3, -0.57, 0.0), (0.3, 0.0, 0.85), 0.015, PORCELAIN, "-z +y", segments=1)
    ring = lathe([(0.0, 0.0), (0.13, 0.0), (0.17, 0.0), (0.17, 0.02), (0.13, 0.03), (0.0, 0.02)], STEEL, 16)
    yield ring.tilted(90.0).placed(0.0, -0.57, 0.0, 0.42)
    yield box((-0.28, -0.58, 0.72), (-0.05, -0.57, 0.81), plain(rgb("d5d9dd")), "+y")
    yield box((0.05, -0.58, 0.74), (0.22, -0.57, 0.79), glow(rgb("3d6f8e")), "+y")


def towels(s: RoomStyle, rng: np.random.Generator) -> Design:
    yield on_wall("towels", 0.37, 0.09, 1.3)
    x, width = 0.35, 0.7
    yield strut((-x, -0.06, 1.2), (x, -0.06, 1.2), 0.01, STEEL)
    for side in (-x + 0.02, x - 0.02):
        yield strut((side, 0.0, 1.2), (side, -0.06, 1.2), 0.01, STEEL)
    for k, towel in enumerate((s.cloth, s.cloth_2)):
        middle, half = -x + (k + 0.5) * width / 2, 0.42 * width / 2
        low, high = (middle - half, -0.085, 0.72 + 0.06 * k), (middle + half, -0.035, 1.215)
        yield cushion(low, high, 0.02, towel, segments=1)


def bottle_shelf(s: RoomStyle, rng: np.random.Generator) -> Design:
    yield on_wall("shelf", 0.3, 0.2, 1.6)
    yield box((-0.6 / 2, -0.2, 1.25), (0.6 / 2, 0.0, 1.25 + 0.03), PORCELAIN, "+y")
    yield clutter.bottle(rgb("5aa9c9")).placed(-0.15, -0.1, 0.0, 1.28)
    yield clutter.bottle(rgb("e5659d")).placed(0.1, -0.1, 0.0, 1.28)
