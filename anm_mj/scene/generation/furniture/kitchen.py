"""Kitchen and bathroom fittings; the back of each lies along y = 0 and it faces -y."""

from anm_mj.scene.generation.quads import Material, Parts, Quads, box, cushion, cylinder, join, joined, strut
from anm_mj.scene.generation.textures import plain, rgb

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
def wall_units(width_m: float, front: Material) -> Parts:
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


def fridge(body: Material) -> Quads:
    """A fridge-freezer 0.6 m wide and 1.8 m high."""
    return join(
        box((-0.3, -0.6, 0.0), (0.3, 0.0, 1.8), body, "-z +y"),
        cushion((-0.3, -0.66, 0.03), (0.3, -0.6, 0.62), 0.015, body, "+y", segments=1),
        cushion((-0.3, -0.66, 0.64), (0.3, -0.6, 1.79), 0.015, body, "+y", segments=1),
        box((0.22, -0.69, 0.4), (0.24, -0.66, 0.58), STEEL, "+y"),
        box((0.22, -0.69, 0.7), (0.24, -0.66, 1.1), STEEL, "+y"),
    )


@joined
def bathtub(length_m: float, depth_m: float, side: Material) -> Parts:
    """A tub 0.56 m high, hollow, walled in on its front."""
    x, rim, high, bottom = length_m / 2, 0.07, 0.56, 0.2
    (x0, y0), (x1, y1) = (-x + rim, -depth_m + rim), (x - rim, -rim)
    thin = 0.001
    for low_m, high_m, skip in (
        ((x0, y0, bottom - 0.01), (x1, y1, bottom), "-x +x -y +y -z"),
        ((x0 - thin, y0, bottom), (x0, y1, high), "-x -y +y -z +z"),
        ((x1, y0, bottom), (x1 + thin, y1, high), "+x -y +y -z +z"),
        ((x0, y0 - thin, bottom), (x1, y0, high), "-y -x +x -z +z"),
        ((x0, y1, bottom), (x1, y1 + thin, high), "+y -x +x -z +z"),
        ((-x, -depth_m, high - 0.03), (x, y0, high), "+y -x +x"),
        ((-x, -rim, high - 0.03), (x, 0.0, high), "-y +y -z -x +x"),
        ((-x, y0, high - 0.03), (x0, -rim, high), "-y +y -z -x +x"),
        ((x1, y0, high - 0.03), (x, -rim, high), "-y +y -z -x +x"),
    ):
        yield box(low_m, high_m, PORCELAIN, skip)
    yield box((-x, -depth_m + 0.02, 0.0), (x, -depth_m + 0.03, high - 0.03), side, "-z +z +y -x +x")
    yield strut((x - 0.03, -depth_m / 2, 0.75), (x - 0.2, -depth_m / 2, 0.72), 0.018, STEEL)
