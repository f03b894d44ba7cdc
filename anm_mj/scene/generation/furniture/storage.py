"""Shelves and cupboards; the back of each lies along y = 0 and it faces -y."""

from __future__ import annotations

import numpy as np

from anm_mj.scene.generation.quads import Material, Quads, box, join
from anm_mj.scene.generation.textures import plain, rgb

_SPINES = [
    plain(rgb(code))
    for code in ("8c2f39", "2f5d8c", "d9a441", "3b6b4f", "e4ddd0", "5b3f73", "c8553d", "27374d", "7d9d9c", "b08968")
]


def bookcase(
    width_m: float, height_m: float, num_shelves: int, wood: Material, seed: int, depth_m: float = 0.28
) -> Quads:
    """An open bookcase, its shelves partly filled with books and boxes."""
    rng = np.random.default_rng(seed)
    x, side = width_m / 2, 0.022
    pieces = [
        box((-x, -depth_m, 0.0), (-x + side, 0.0, height_m), wood, "-z +y"),
        box((x - side, -depth_m, 0.0), (x, 0.0, height_m), wood, "-z +y"),
        box((-x + side, -0.012, 0.06), (x - side, 0.0, height_m), wood, "-z +y -x +x +z"),
        box((-x + side, -depth_m + 0.02, 0.0), (x - side, -depth_m + 0.035, 0.06), wood, "-z +z -x +x"),
    ]
    pitch = (height_m - 0.06 - side) / num_shelves
    for k in range(num_shelves + 1):
        z = 0.06 + k * pitch
        pieces.append(box((-x + side, -depth_m, z), (x - side, -0.012, z + side), wood, "-x +x +y"))
    for k in range(num_shelves):
        pieces.extend(_row_of_books(rng, -x + side, x - side, 0.06 + k * pitch + side, pitch - side - 0.03, depth_m))
    return join(*pieces)


def _row_of_books(
    rng: np.random.Generator, left_m: float, right_m: float, z_m: float, room_m: float, depth_m: float
) -> list[Quads]:
    """Books upright in groups, with gaps and here and there a lying pile; perhaps none at all."""
    pieces: list[Quads] = []
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
                pieces.append(box(low, high, _SPINES[rng.integers(len(_SPINES))], "-z"))
                height += thick
            cursor += 0.26
            continue
        thick, tall = rng.uniform(0.022, 0.05), min(rng.uniform(0.19, 0.29), room_m)
        deep = rng.uniform(0.16, 0.22)
        low, high = (cursor, -0.02 - deep, z_m), (cursor + thick, -0.02, z_m + tall)
        pieces.append(box(low, high, _SPINES[rng.integers(len(_SPINES))], "-z"))
        cursor += thick + 0.001
    return pieces


def wardrobe(width_m: float, height_m: float, depth_m: float, body: Material, door: Material, knob: Material) -> Quads:
    """A closed wardrobe with doors about half a metre wide."""
    x = width_m / 2
    pieces = [box((-x, -depth_m + 0.02, 0.0), (x, 0.0, height_m), body, "-z +y")]
    num_doors = max(2, round(width_m / 0.5))
    share = width_m / num_doors
    for k in range(num_doors):
        left = -x + k * share
        low, high = (left + 0.004, -depth_m, 0.07), (left + share - 0.004, -depth_m + 0.02, height_m - 0.03)
        pieces.append(box(low, high, door, "+y"))
        inset = 0.08
        low = (left + inset, -depth_m - 0.008, 0.07 + inset)
        high = (left + share - inset, -depth_m, height_m - 0.03 - inset)
        pieces.append(box(low, high, door, "+y"))
        grip = left + (share - 0.05 if k % 2 == 0 else 0.035)
        pieces.append(box((grip, -depth_m - 0.03, 0.95), (grip + 0.015, -depth_m, 1.15), knob, "+y"))
    return join(*pieces)


def wall_shelf(width_m: float, z_m: float, wood: Material, depth_m: float = 0.2) -> Quads:
    """A board on the wall."""
    return box((-width_m / 2, -depth_m, z_m), (width_m / 2, 0.0, z_m + 0.03), wood, "+y")


def cubbies(columns: int, rows: int, cell_m: float, wood: Material, fills: tuple[Material, ...], seed: int) -> Quads:
    """A low shelf of square compartments, most of them holding a box."""
    rng = np.random.default_rng(seed)
    wall, depth = 0.02, 0.32
    width, height = columns * cell_m + wall, rows * cell_m + wall
    x = width / 2
    pieces = [box((-x, -0.012, 0.0), (x, 0.0, height), wood, "-z +y -x +x +z")]
    for k in range(columns + 1):
        left = -x + k * cell_m
        pieces.append(box((left, -depth, 0.0), (left + wall, -0.012, height), wood, "-z +y"))
    for k in range(rows + 1):
        for column in range(columns):
            left, z = -x + column * cell_m + wall, k * cell_m
            pieces.append(box((left, -depth, z), (left + cell_m - wall, -0.012, z + wall), wood, "-x +x +y"))
    for row in range(rows):
        for column in range(columns):
            if rng.random() < 0.25:
                continue
            left, z = -x + column * cell_m + wall + 0.012, row * cell_m + wall
            low, high = (
                (left, -depth + 0.015, z),
                (left + cell_m - wall - 0.024, -0.03, z + cell_m * rng.uniform(0.55, 0.85)),
            )
            pieces.append(box(low, high, fills[rng.integers(len(fills))], "-z +y"))
    return join(*pieces)


def coat_rack(width_m: float, board: Material, coats: tuple[Material, ...]) -> Quads:
    """A board with hooks at 1.7 m and coats hanging from it."""
    x = width_m / 2
    pieces = [box((-x, -0.025, 1.62), (x, 0.0, 1.74), board, "+y")]
    for k, coat in enumerate(coats):
        middle = -x + (k + 0.5) * width_m / len(coats)
        length = 0.75 + 0.12 * (k % 2)
        for part, (half, top, bottom, front) in enumerate(((0.17, 1.62, 1.62 - length, 0.09), (0.2, 1.5, 1.35, 0.11))):
            skip = "+y" if part == 0 else "+y -z +z"
            pieces.append(box((middle - half, -0.02 - front, bottom), (middle + half, -0.02, top), coat, skip))
    return join(*pieces)
