"""Kitchen and bathroom fittings; the back of each lies along y = 0 and it faces -y."""

from __future__ import annotations

from anm_mj.scene.generation.quads import Material, Quads, box, cushion, cylinder, join, lathe, strut
from anm_mj.scene.generation.textures import glow, plain, rgb

_STEEL = plain(rgb("b9bec4"))
_BLACK = plain(rgb("23262b"))
_PORCELAIN = plain(rgb("f3f4f2"), 0.005)


def counter(width_m: float, front: Material, top: Material, oven_at_m: float | None = None) -> Quads:
    """Base units 0.6 m deep and 0.9 m high, with a hob and an oven about ``oven_at_m`` along x."""
    x, depth = width_m / 2, 0.6
    pieces = [
        box((-x, -depth + 0.06, 0.0), (x, 0.0, 0.1), _BLACK, "-z +y +z"),
        box((-x, -depth + 0.02, 0.1), (x, 0.0, 0.86), front, "+y +z"),
        box((-x, -depth - 0.01, 0.86), (x, 0.0, 0.9), top, "+y"),
    ]
    num_units = max(1, round(width_m / 0.6))
    share = width_m / num_units
    for k in range(num_units):
        left = -x + k * share
        is_oven = oven_at_m is not None and left <= oven_at_m < left + share
        panel = _BLACK if is_oven else front
        pieces.append(box((left + 0.004, -depth, 0.11), (left + share - 0.004, -depth + 0.02, 0.85), panel, "+y"))
        low, high = (left + 0.12, -depth - 0.03, 0.77), (left + share - 0.12, -depth, 0.785)
        pieces.append(box(low, high, _STEEL, "+y"))
        if is_oven:
            pieces.append(box((left + 0.02, -0.53, 0.9), (left + share - 0.02, -0.08, 0.906), _BLACK, "-z"))
            for px, py in ((0.28, -0.42), (0.72, -0.42), (0.28, -0.19), (0.72, -0.19)):
                pieces.append(cylinder(0.075, 0.906, 0.909, plain(rgb("4a4d52")), 12).placed(left + px * share, py))
    return join(*pieces)


def sink(steel: Material = _STEEL) -> Quads:
    """A basin that lies on a worktop at z = 0, with a tap."""
    rim, wall = 0.012, 0.02
    inner_x, inner_y = 0.22, 0.16
    return join(
        box((-inner_x - wall, -inner_y - wall - 0.28, 0.0), (inner_x + wall, inner_y + wall - 0.28, rim), steel, "-z"),
        box((-inner_x, -inner_y - 0.28, rim), (inner_x, inner_y - 0.28, rim + 0.002), plain(rgb("7f858c")), "-z"),
        cylinder(0.018, 0.0, 0.22, steel, 8).placed(0.0, -0.07),
        strut((0.0, -0.07, 0.21), (0.0, -0.24, 0.24), 0.012, steel),
    )


def wall_units(width_m: float, front: Material, z_low_m: float = 1.45, height_m: float = 0.7) -> Quads:
    """Upper cabinets 0.34 m deep."""
    x, depth = width_m / 2, 0.34
    pieces = [box((-x, -depth + 0.02, z_low_m), (x, 0.0, z_low_m + height_m), front, "+y")]
    num_doors = max(1, round(width_m / 0.45))
    share = width_m / num_doors
    for k in range(num_doors):
        left = -x + k * share
        low = (left + 0.004, -depth, z_low_m + 0.004)
        pieces.append(box(low, (left + share - 0.004, -depth + 0.02, z_low_m + height_m - 0.004), front, "+y"))
        middle = left + share / 2
        low, high = (middle - 0.06, -depth - 0.02, z_low_m + 0.04), (middle + 0.06, -depth, z_low_m + 0.055)
        pieces.append(box(low, high, _STEEL, "+y"))
    return join(*pieces)


def fridge(body: Material) -> Quads:
    """A fridge-freezer 0.6 m wide and 1.8 m high."""
    return join(
        box((-0.3, -0.6, 0.0), (0.3, 0.0, 1.8), body, "-z +y"),
        cushion((-0.3, -0.66, 0.03), (0.3, -0.6, 0.62), 0.015, body, "+y", segments=1),
        cushion((-0.3, -0.66, 0.64), (0.3, -0.6, 1.79), 0.015, body, "+y", segments=1),
        box((0.22, -0.69, 0.4), (0.24, -0.66, 0.58), _STEEL, "+y"),
        box((0.22, -0.69, 0.7), (0.24, -0.66, 1.1), _STEEL, "+y"),
    )


def washing_machine() -> Quads:
    """A front-loader 0.6 m wide."""
    ring = lathe([(0.0, 0.0), (0.13, 0.0), (0.17, 0.0), (0.17, 0.02), (0.13, 0.03), (0.0, 0.02)], _STEEL, 16)
    return join(
        cushion((-0.3, -0.57, 0.0), (0.3, 0.0, 0.85), 0.015, _PORCELAIN, "-z +y", segments=1),
        ring.tilted(90.0).placed(0.0, -0.57, 0.0, 0.42),
        box((-0.28, -0.58, 0.72), (-0.05, -0.57, 0.81), plain(rgb("d5d9dd")), "+y"),
        box((0.05, -0.58, 0.74), (0.22, -0.57, 0.79), glow(rgb("3d6f8e")), "+y"),
    )


def toilet() -> Quads:
    """A close-coupled toilet."""
    bowl = lathe(
        [(0.11, 0.0), (0.12, 0.1), (0.17, 0.3), (0.2, 0.38), (0.21, 0.41), (0.2, 0.43), (0.0, 0.44)], _PORCELAIN, 16
    )
    return join(
        bowl.placed(0.0, -0.42),
        box((-0.1, -0.35, 0.0), (0.1, -0.05, 0.36), _PORCELAIN, "-z +z"),
        cushion((-0.2, -0.2, 0.36), (0.2, 0.0, 0.82), 0.025, _PORCELAIN, "+y", segments=1),
        box((-0.03, -0.12, 0.82), (0.03, -0.07, 0.83), _STEEL, "-z"),
    )


def basin(front: Material) -> Quads:
    """A wash-basin on a cabinet 0.7 m wide, with a mirror above it."""
    bowl = lathe([(0.08, 0.0), (0.17, 0.05), (0.19, 0.1), (0.17, 0.1), (0.1, 0.03), (0.0, 0.02)], _PORCELAIN, 16)
    mirror = plain(rgb("b9d0da"), 0.08)
    return join(
        box((-0.35, -0.43, 0.1), (0.35, 0.0, 0.78), front, "+y"),
        *(box((x, -0.45, 0.12), (x + 0.33, -0.43, 0.76), front, "+y") for x in (-0.34, 0.01)),
        *(box((x, -0.47, 0.5), (x + 0.015, -0.45, 0.62), _STEEL, "+y") for x in (-0.04, 0.025)),
        box((-0.36, -0.46, 0.78), (0.36, 0.0, 0.82), plain(rgb("e8e2d6")), "+y"),
        bowl.placed(0.0, -0.24, 0.0, 0.82),
        cylinder(0.014, 0.82, 1.02, _STEEL, 8).placed(0.0, -0.05),
        strut((0.0, -0.05, 1.01), (0.0, -0.17, 1.0), 0.011, _STEEL),
        box((-0.3, -0.02, 1.15), (0.3, 0.0, 1.85), mirror, "+y"),
    )


def bathtub(length_m: float, depth_m: float, side: Material) -> Quads:
    """A tub 0.56 m high, hollow, walled in on its front."""
    x, rim, high, bottom = length_m / 2, 0.07, 0.56, 0.2
    (x0, y0), (x1, y1) = (-x + rim, -depth_m + rim), (x - rim, -rim)
    thin = 0.001
    inside = [
        box((x0, y0, bottom - 0.01), (x1, y1, bottom), _PORCELAIN, "-x +x -y +y -z"),
        box((x0 - thin, y0, bottom), (x0, y1, high), _PORCELAIN, "-x -y +y -z +z"),
        box((x1, y0, bottom), (x1 + thin, y1, high), _PORCELAIN, "+x -y +y -z +z"),
        box((x0, y0 - thin, bottom), (x1, y0, high), _PORCELAIN, "-y -x +x -z +z"),
        box((x0, y1, bottom), (x1, y1 + thin, high), _PORCELAIN, "+y -x +x -z +z"),
    ]
    rim_pieces = [
        box((-x, -depth_m, high - 0.03), (x, -depth_m + rim, high), _PORCELAIN, "+y -x +x"),
        box((-x, -rim, high - 0.03), (x, 0.0, high), _PORCELAIN, "-y +y -z -x +x"),
        box((-x, -depth_m + rim, high - 0.03), (-x + rim, -rim, high), _PORCELAIN, "-y +y -z -x +x"),
        box((x - rim, -depth_m + rim, high - 0.03), (x, -rim, high), _PORCELAIN, "-y +y -z -x +x"),
    ]
    apron = box((-x, -depth_m + 0.02, 0.0), (x, -depth_m + 0.03, high - 0.03), side, "-z +z +y -x +x")
    tap = strut((x - 0.03, -depth_m / 2, 0.75), (x - 0.2, -depth_m / 2, 0.72), 0.018, _STEEL)
    return join(*inside, *rim_pieces, apron, tap)


def towel_rail(width_m: float, towels: tuple[Material, ...]) -> Quads:
    """A rail at 1.2 m with towels over it."""
    x = width_m / 2
    pieces = [strut((-x, -0.06, 1.2), (x, -0.06, 1.2), 0.01, _STEEL)]
    pieces += [strut((side, 0.0, 1.2), (side, -0.06, 1.2), 0.01, _STEEL) for side in (-x + 0.02, x - 0.02)]
    for k, towel in enumerate(towels):
        middle = -x + (k + 0.5) * width_m / len(towels)
        half = 0.42 * width_m / len(towels)
        low, high = (middle - half, -0.085, 0.72 + 0.06 * k), (middle + half, -0.035, 1.215)
        pieces.append(cushion(low, high, 0.02, towel, segments=1))
    return join(*pieces)
