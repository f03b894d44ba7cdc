"""Tables, desks and beds; each stands about the origin unless it says otherwise."""

from anm_mj.scene.generation.quads import Material, Parts, box, cushion, joined


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
    """A desk with a block of drawers on its right; its back lies along y = 0 and it faces -y."""
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
    """A chest of drawers on feet, its back along y = 0 and facing -y."""
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
