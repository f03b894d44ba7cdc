"""Chairs and sofas; each stands about the origin and faces -y."""

import math

from anm_mj.scene.generation.quads import Material, Parts, ball, box, cushion, cylinder, joined, lathe, strut


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
