"""Chairs, sofas, tables, beds, cupboards and bookcases.

Seats and tables stand about the origin; the back of desks, beds and all that holds things lies along y = 0. Each faces
-y.
"""

import math

import numpy as np

from anm_mj.scene.generation.quads import Material, Parts, ball, box, cushion, cylinder, joined, lathe, strut
from anm_mj.scene.generation.textures import plain, rgb

_SPINES = [
    plain(rgb(code))
    for code in ("8c2f39", "2f5d8c", "d9a441", "3b6b4f", "e4ddd0", "5b3f73", "c8553d", "27374d", "7d9d9c", "b08968")
]


@joined
def chair(frame: Material, seat: Material) -> Parts:
    """A kitchen chair 0.42 m square: four thin legs, a seat, a back of slats."""
    half, leg, seat_z, top = 0.21, 0.034, 0.45, 0.88
    yield cushion((-half, -half, seat_z - 0.04), (half, half, seat_z), 0.015, seat, segments=1)
    for x in (-half, half - leg):
        yield box((x, -half, 0.0), (x + leg, -half + leg, seat_z - 0.03), frame, "-z +z")
        yield box((x, half - leg, 0.0), (x + leg, half, top), frame, "-z")
        yield box((x + 0.008, -half + leg, 0.2), (x + leg - 0.008, half - leg, 0.225), frame, "-y +y")
    for z in (0.58, 0.68, 0.78):
        yield box((-half + leg, half - 0.026, z), (half - leg, half - 0.008, z + 0.06), frame, "-x +x")


@joined
def stool(wood: Material, seat: Material) -> Parts:
    """A round stool on three splayed legs."""
    yield lathe([(0.0, 0.41), (0.17, 0.41), (0.175, 0.43), (0.16, 0.45), (0.0, 0.455)], seat, 14)
    for k in range(3):
        c, s = math.cos(2.1 * k + 0.5), math.sin(2.1 * k + 0.5)
        yield strut((0.17 * c, 0.17 * s, 0.003), (0.11 * c, 0.11 * s, 0.42), 0.016, wood)


@joined
def sofa(width_m: float, cover: Material, cushions: tuple[Material, ...], legs: Material) -> Parts:
    """A sofa 0.9 m deep with its back along +y, on short legs; one loose cushion per material of ``cushions``."""
    half, front, back, arm = width_m / 2, -0.45, 0.45, 0.2
    yield box((-half + 0.03, front + 0.06, 0.12), (half - 0.03, back - 0.03, 0.28), cover, "+z")
    yield cushion((-half, back - 0.24, 0.12), (half, back, 0.82), 0.07, cover)
    for x in (-half, half - arm):
        yield cushion((x, front, 0.12), (x + arm, back - 0.06, 0.6), 0.06, cover)
        for y in (front + 0.06, back - 0.1):
            yield cylinder(0.025, 0.0, 0.13, legs, 6).placed(x + arm / 2, y)
    num_seats = max(1, round((width_m - 2 * arm) / 0.7))
    seat = (width_m - 2 * arm) / num_seats
    for k in range(num_seats):
        x = -half + arm + k * seat
        yield cushion((x + 0.004, front, 0.25), (x + seat - 0.004, back - 0.2, 0.45), 0.05, cover)
    for k, material in enumerate(cushions):
        x = -half + arm + 0.24 + k * (width_m - 2 * arm - 0.48) / max(len(cushions) - 1, 1)
        pillow = cushion((-0.21, -0.07, 0.0), (0.21, 0.07, 0.4), 0.065, material)
        yield pillow.tilted(-16.0).placed(x, 0.1, 8.0 - 14.0 * (k % 2), 0.44)


@joined
def office_chair(metal: Material, cover: Material) -> Parts:
    """A swivel chair on a five-star base with castors."""
    yield cylinder(0.025, 0.07, 0.42, metal, 8)
    for k in range(5):
        angle = 2.0 * math.pi * k / 5 + 0.3
        c, s = math.cos(angle), math.sin(angle)
        yield strut((0.02 * c, 0.02 * s, 0.1), (0.27 * c, 0.27 * s, 0.075), 0.018, metal)
        yield ball(0.03, metal, 6).placed(0.27 * c, 0.27 * s)
    yield cushion((-0.24, -0.24, 0.42), (0.24, 0.22, 0.51), 0.04, cover)
    yield strut((0.0, 0.2, 0.44), (0.0, 0.27, 0.62), 0.02, metal)
    yield cushion((-0.22, 0.0, 0.0), (0.22, 0.08, 0.46), 0.035, cover).tilted(-8.0).placed(0.0, 0.2, 0.0, 0.58)
    for x in (-0.27, 0.23):
        yield box((x, -0.14, 0.66), (x + 0.04, 0.12, 0.69), metal)
        yield box((x + 0.008, -0.02, 0.46), (x + 0.032, 0.01, 0.66), metal, "+z")


@joined
def table(
    width_m: float, depth_m: float, height_m: float, wood: Material, leg_m: float = 0.04, shelf: bool = False
) -> Parts:
    """A table on four thin square legs, with a frame below its top and perhaps a shelf near the floor."""
    x, y, inset, low = width_m / 2, depth_m / 2, 0.03, height_m - 0.03
    yield box((-x, -y, low), (x, y, height_m), wood)
    middle_x, middle_y, half = x - inset - leg_m / 2, y - inset - leg_m / 2, leg_m / 2
    for sx in (-1, 1):
        for sy in (-1, 1):
            cx, cy = sx * middle_x, sy * middle_y
            yield box((cx - half, cy - half, 0.0), (cx + half, cy + half, low), wood, "-z +z")
    rail = low - 0.07
    for sign in (-1, 1):
        cy, cx = sign * middle_y, sign * middle_x
        long_end, short_end = x - inset - leg_m, y - inset - leg_m
        yield box((-long_end, cy - 0.01, rail), (long_end, cy + 0.01, low), wood, "+z -x +x")
        yield box((cx - 0.01, -short_end, rail), (cx + 0.01, short_end, low), wood, "+z -y +y")
    if shelf:
        yield box((-x + inset, -y + inset, 0.14), (x - inset, y - inset, 0.16), wood)


@joined
def desk(width_m: float, depth_m: float, wood: Material, front: Material) -> Parts:
    """A desk with a block of drawers on its right."""
    x, top = width_m / 2, 0.74
    yield box((-x, -depth_m, top - 0.03), (x, 0.0, top), wood)
    for y in (-depth_m + 0.03, -0.07):
        yield box((-x + 0.03, y, 0.0), (-x + 0.07, y + 0.04, top - 0.03), wood, "-z +z")
    yield box((x - 0.45, -depth_m + 0.04, 0.03), (x - 0.03, -0.02, top - 0.03), wood, "+z")
    for k in range(3):
        z = 0.06 + 0.215 * k
        yield box((x - 0.44, -depth_m + 0.02, z), (x - 0.04, -depth_m + 0.04, z + 0.2), front, "+y")
        yield box((x - 0.29, -depth_m, z + 0.13), (x - 0.19, -depth_m + 0.02, z + 0.145), wood, "+y")


@joined
def bed(width_m: float, frame: Material, sheet: Material, blanket: Material, pillows: tuple[Material, ...]) -> Parts:
    """A bed 2.06 m long with its head at y = 0 and its foot towards -y, on four legs."""
    x, length = width_m / 2, 2.06
    yield box((-x, -0.06, 0.0), (x, 0.0, 0.95), frame, "-z +y")
    yield box((-x, -length, 0.18), (x, -0.06, 0.3), frame, "+y +z")
    yield box((-x, -length - 0.03, 0.18), (x, -length, 0.46), frame, "+y")
    yield cushion((-x + 0.02, -length + 0.02, 0.28), (x - 0.02, -0.07, 0.5), 0.05, sheet, "-z")
    yield cushion((-x - 0.015, -length + 0.01, 0.34), (x + 0.015, -0.72, 0.54), 0.05, blanket, "-z")
    yield cushion((-x - 0.012, -0.92, 0.44), (x + 0.012, -0.66, 0.565), 0.04, sheet, "-z")
    for side in (-1, 1):
        leg = side * (x - 0.04)
        yield box((leg - 0.03, -length + 0.03, 0.0), (leg + 0.03, -length + 0.09, 0.18), frame, "-z +z")
    share = width_m / len(pillows)
    for k, pillow in enumerate(pillows):
        left = -x + k * share
        yield cushion((left + 0.08, -0.5, 0.0), (left + share - 0.08, -0.1, 0.15), 0.07, pillow).placed(z_m=0.49)


@joined
def chest(width_m: float, depth_m: float, height_m: float, rows: int, body: Material, front: Material) -> Parts:
    """A chest of drawers on feet."""
    x, foot = width_m / 2, 0.09
    yield box((-x, -depth_m + 0.02, foot), (x, 0.0, height_m), body, "+y")
    for side in (-1, 1):
        for y in (-depth_m + 0.05, -0.08):
            leg = side * (x - 0.04)
            yield box((leg - 0.017, y, 0.0), (leg + 0.017, y + 0.034, foot), body, "-z +z")
    pitch = (height_m - foot - 0.02) / rows
    columns = max(1, round(width_m / 0.75))
    share = (width_m - 0.02) / columns
    for row in range(rows):
        for column in range(columns):
            left, z = -x + 0.01 + column * share, foot + 0.01 + row * pitch
            low, high = (left + 0.006, -depth_m, z + 0.006), (left + share - 0.006, -depth_m + 0.02, z + pitch - 0.006)
            yield box(low, high, front, "+y")
            middle, grip = left + share / 2, z + 0.6 * pitch
            yield box((middle - 0.05, -depth_m - 0.02, grip), (middle + 0.05, -depth_m, grip + 0.015), body, "+y")


@joined
def bookcase(
    width_m: float, height_m: float, num_shelves: int, wood: Material, seed: int, depth_m: float = 0.28
) -> Parts:
    """An open bookcase, its shelves partly filled with books and boxes."""
    rng = np.random.default_rng(seed)
    x, side = width_m / 2, 0.022
    yield box((-x, -depth_m, 0.0), (-x + side, 0.0, height_m), wood, "-z +y")
    yield box((x - side, -depth_m, 0.0), (x, 0.0, height_m), wood, "-z +y")
    yield box((-x + side, -0.012, 0.06), (x - side, 0.0, height_m), wood, "-z +y -x +x +z")
    yield box((-x + side, -depth_m + 0.02, 0.0), (x - side, -depth_m + 0.035, 0.06), wood, "-z +z -x +x")
    pitch = (height_m - 0.06 - side) / num_shelves
    for k in range(num_shelves + 1):
        z = 0.06 + k * pitch
        yield box((-x + side, -depth_m, z), (x - side, -0.012, z + side), wood, "-x +x +y")
    for k in range(num_shelves):
        yield from _row_of_books(rng, -x + side, x - side, 0.06 + k * pitch + side, pitch - side - 0.03, depth_m)


def _row_of_books(
    rng: np.random.Generator, left_m: float, right_m: float, z_m: float, room_m: float, depth_m: float
) -> Parts:
    """Books upright in groups, with gaps and here and there a lying pile; perhaps none at all."""
    cursor = left_m + 0.01
    while cursor < right_m - 0.06:
        if rng.random() < 0.22:
            cursor += rng.uniform(0.06, 0.2)
            continue
        if rng.random() < 0.15 and cursor < right_m - 0.26:
            height = z_m
            for _ in range(int(rng.integers(2, 5))):
                thick, length = rng.uniform(0.02, 0.04), rng.uniform(0.18, 0.24)
                low, high = (cursor, -depth_m + 0.03, height), (cursor + length, -0.05, height + thick)
                yield box(low, high, _SPINES[rng.integers(len(_SPINES))], "-z")
                height += thick
            cursor += 0.26
            continue
        thick, tall = rng.uniform(0.022, 0.05), min(rng.uniform(0.19, 0.29), room_m)
        low, high = (cursor, -0.02 - rng.uniform(0.16, 0.22), z_m), (cursor + thick, -0.02, z_m + tall)
        yield box(low, high, _SPINES[rng.integers(len(_SPINES))], "-z")
        cursor += thick + 0.001


@joined
def wardrobe(width_m: float, height_m: float, depth_m: float, body: Material, door: Material, knob: Material) -> Parts:
    """A closed wardrobe with doors about half a metre wide."""
    x, inset = width_m / 2, 0.08
    yield box((-x, -depth_m + 0.02, 0.0), (x, 0.0, height_m), body, "-z +y")
    num_doors = max(2, round(width_m / 0.5))
    share = width_m / num_doors
    for k in range(num_doors):
        left, right, top = -x + k * share, -x + k * share + share, height_m - 0.03
        yield box((left + 0.004, -depth_m, 0.07), (right - 0.004, -depth_m + 0.02, top), door, "+y")
        yield box((left + inset, -depth_m - 0.008, 0.07 + inset), (right - inset, -depth_m, top - inset), door, "+y")
        grip = left + (share - 0.05 if k % 2 == 0 else 0.035)
        yield box((grip, -depth_m - 0.03, 0.95), (grip + 0.015, -depth_m, 1.15), knob, "+y")
