"""Bookcases and cupboards; the back of each lies along y = 0 and it faces -y."""

import numpy as np

from anm_mj.scene.generation.quads import Material, Parts, box, joined
from anm_mj.scene.generation.textures import plain, rgb

_SPINES = [
    plain(rgb(code))
    for code in ("8c2f39", "2f5d8c", "d9a441", "3b6b4f", "e4ddd0", "5b3f73", "c8553d", "27374d", "7d9d9c", "b08968")
]


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
