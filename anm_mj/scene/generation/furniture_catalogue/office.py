"""Furniture catalogue: offices. Each function draws one piece of a room's style, its sizes by chance."""

import numpy as np

from anm_mj.scene.generation.furniture import clutter, decor, standing
from anm_mj.scene.generation.furniture_catalogue.kitchen_and_bath import counter, sink
from anm_mj.scene.generation.piece import Design, Piece, against_wall, on_wall
from anm_mj.scene.generation.quads import box, join, lathe
from anm_mj.scene.generation.room_style import DARK, METAL, WHITE, RoomStyle
from anm_mj.scene.generation.textures import abstract, glow, landscape, plain, rgb

_GREY = plain(rgb("c9ccd1"), 0.03)


def desk_island(s: RoomStyle, rng: np.random.Generator, per_side: int) -> Design:
    width, depth = 1.5, 0.7
    total = per_side * width
    seats = [(-total / 2 + (k + 0.5) * width, side) for k in range(per_side) for side in (-1, 1)]
    turns, seeds = [float(rng.uniform(-60.0, 60.0)) for _ in seats], [int(rng.integers(1000)) for _ in seats]
    away = [float(rng.uniform(0.0, 0.15)) for _ in seats]
    reach = depth + 0.02
    solids = [(-total / 2, -reach, total / 2, reach)]
    for (x, side), out in zip(seats, away, strict=True):
        cx, cy = x + (-0.1 if side < 0 else 0.1), side * (0.92 + out)
        solids.append((cx - 0.32, cy - 0.32, cx + 0.32, cy + 0.32))
    yield Piece("desk island", "middle", tuple(solids), 0.5, 1.2)
    yield box((-total / 2, -0.015, 0.3), (total / 2, 0.015, 1.2), s.paint)
    for (x, side), turn, seed, out in zip(seats, turns, seeds, away, strict=True):
        place = join(
            standing.desk(width - 0.01, depth, s.wood, WHITE),
            decor.monitor(landscape(seed, 0.57, 0.31)).placed(-0.1, -0.02, 0.0, 0.74),
            clutter.cup(s.colours[seed % len(s.colours)]).placed(-0.55, -0.4, 0.0, 0.74),
            clutter.stack_of_books(1 + seed % 4, seed).placed(0.55, -0.3, 10.0, 0.74),
            standing.office_chair(DARK, s.cloth).placed(-0.1, -0.9 - out, 180.0 + turn),
        )
        yield place.placed(0.0, -0.02).placed(x, 0.0, 0.0 if side < 0 else 180.0)


def meeting_table(s: RoomStyle, rng: np.random.Generator, seats: int) -> Design:
    per_side = seats // 2
    width, depth = 0.8 * per_side, 1.1
    places = [
        (-width / 2 + (k + 0.5) * width / per_side, side * (depth / 2 + 0.28), side)
        for k in range(per_side)
        for side in (-1, 1)
    ]
    turns = [float(rng.uniform(-35.0, 35.0)) for _ in places]
    chairs = [(x - 0.32, y - 0.32, x + 0.32, y + 0.32) for x, y, _ in places]
    yield Piece("meeting table", "middle", ((-width / 2, -depth / 2, width / 2, depth / 2), *chairs), 0.45, 0.9)
    yield standing.table(width, depth, 0.74, s.wood, leg_m=0.06)
    for (x, y, side), turn in zip(places, turns, strict=True):
        yield standing.office_chair(METAL, s.cloth).placed(x, y, (0.0 if side > 0 else 180.0) + turn)
    yield clutter.cup(s.colours[1]).placed(-0.4, 0.3, 0.0, 0.74)
    yield clutter.cup(s.colours[2]).placed(0.5, -0.35, 0.0, 0.74)
    yield clutter.stack_of_books(2, seats).placed(0.1, 0.1, 30.0, 0.74)


def whiteboard(s: RoomStyle, rng: np.random.Generator) -> Design:
    width, seed = float(rng.uniform(1.2, 2.0)), int(rng.integers(1000))
    yield on_wall("whiteboard", width / 2 + 0.05, 0.05, 1.95)
    yield decor.picture(width, 0.9, 1.0, plain(rgb("f6f8f9"), 0.01), METAL)
    yield decor.picture(0.4, 0.3, 1.45, abstract(seed, 0.4, 0.3), WHITE).placed(0.3, -0.012)


def filing(s: RoomStyle, rng: np.random.Generator) -> Design:
    width, seed = float(rng.choice([0.8, 1.2])), int(rng.integers(1000))
    yield against_wall("filing cabinet", width, 0.54, 1.35, 0.6)
    yield standing.chest(width, 0.5, 1.0, 3, _GREY, _GREY)
    if seed % 2:
        yield join(
            box((-0.24, -0.2, 0.0), (0.24, 0.2, 0.26), plain(rgb("e6e7e9"), 0.02), "-z"),
            box((-0.2, -0.3, 0.06), (0.2, -0.2, 0.08), DARK),
            box((0.08, -0.205, 0.18), (0.2, -0.2, 0.23), glow(rgb("3d6f8e")), "+y"),
        ).placed(0.0, -0.28, 0.0, 1.0)
    else:
        yield decor.plant(0.4, 9, plain(s.colours[3]), seed).placed(0.1, -0.25, 0.0, 1.0)


def copier(s: RoomStyle, rng: np.random.Generator) -> Design:
    shell = plain(rgb("dcdee1"), 0.02)
    yield against_wall("copier", 1.26, 0.68, 1.02, 0.7)
    yield box((-0.32, -0.64, 0.04), (0.32, 0.0, 0.86), shell, "+y -z")
    yield box((-0.34, -0.66, 0.86), (0.34, 0.0, 1.02), plain(rgb("5b6068")), "+y")
    for z in (0.1, 0.3, 0.5):
        yield box((-0.3, -0.66, z), (0.3, -0.64, z + 0.17), plain(rgb("c3c6ca"), 0.02), "+y")
    yield box((0.34, -0.45, 0.55), (0.62, -0.1, 0.57), shell)
    yield box((-0.1, -0.67, 0.9), (0.2, -0.66, 0.98), glow(rgb("4d86a8")), "+y")


def racks(s: RoomStyle, rng: np.random.Generator) -> Design:
    width, seed = float(rng.uniform(1.0, 1.6)), int(rng.integers(1000))
    yield against_wall("shelves", width, 0.4, 2.0, 0.6)
    yield standing.bookcase(width, 2.0, 5, METAL, seed, 0.4)


def lockers(s: RoomStyle, rng: np.random.Generator) -> Design:
    yield against_wall("lockers", 1.2, 0.5, 1.9, 0.6)
    yield standing.wardrobe(1.2, 1.9, 0.45, METAL, s.paint, DARK)


def reception_desk(s: RoomStyle, rng: np.random.Generator) -> Design:
    width, seed = float(rng.uniform(1.8, 2.4)), int(rng.integers(1000))
    x = width / 2
    yield Piece("reception desk", "middle", ((-x - 0.03, -0.4, x + 0.03, 0.35), (-0.12, 0.43, 0.52, 1.07)), 0.8, 1.2)
    yield box((-x, -0.32, 0.0), (x, -0.26, 1.05), s.paint, "-z")
    yield box((-x - 0.03, -0.4, 1.05), (x + 0.03, -0.1, 1.09), s.wood_dark)
    yield box((-x, -0.26, 0.7), (x, 0.35, 0.74), s.wood)
    yield box((-x, -0.26, 0.0), (-x + 0.04, 0.35, 0.7), s.paint, "-z +z")
    yield box((x - 0.04, -0.26, 0.0), (x, 0.35, 0.7), s.paint, "-z +z")
    yield decor.television(0.5, abstract(seed, 0.47, 0.25)).placed(0.3, 0.05, 180.0, 0.74)
    yield clutter.vase(s.colours[2], seed).placed(-x + 0.25, -0.25, 0.0, 1.09)
    yield standing.office_chair(DARK, s.cloth_2).placed(0.2, 0.75, 160.0)


def laboratory_bench(s: RoomStyle, rng: np.random.Generator) -> Design:
    width, seed = float(rng.uniform(1.8, 2.6)), int(rng.integers(1000))
    yield against_wall("laboratory bench", width, 0.66, 1.5, 0.8)
    yield counter(width, _GREY, DARK)
    yield sink().placed(-width / 2 + 0.4, 0.0, 0.0, 0.9)
    yield decor.television(0.5, abstract(seed, 0.47, 0.25)).placed(0.4, -0.25, 10.0, 0.9)
    for k in range(3):
        yield clutter.bottle(s.colours[k]).placed(-0.1 + 0.11 * k, -0.15, 0.0, 0.9)
    yield box((width / 2 - 0.5, -0.45, 0.9), (width / 2 - 0.1, -0.1, 1.2), s.paint, "-z")


def laboratory_island(s: RoomStyle, rng: np.random.Generator) -> Design:
    width, seed = float(rng.uniform(1.5, 2.0)), int(rng.integers(1000))
    stools = [(x, y) for x in (-0.35 * width, 0.35 * width) for y in (-0.68, 0.68)]
    solids = [(-width / 2, -0.45, width / 2, 0.45), *((x - 0.19, y - 0.19, x + 0.19, y + 0.19) for x, y in stools)]
    yield Piece("laboratory table", "middle", tuple(solids), 0.5, 1.1)
    yield standing.table(width, 0.9, 0.92, METAL, leg_m=0.05, shelf=True)
    for x, y in stools:
        yield standing.stool(METAL, DARK).placed(x, y)
    for k in range(4):
        yield clutter.bottle(s.colours[k]).placed(-0.3 + 0.14 * k, 0.1, 0.0, 0.92)
    yield clutter.carton(0.3, 0.25, 0.2).placed(0.5, -0.1, 20.0, 0.92)
    yield clutter.stack_of_books(2, seed).placed(-0.55, -0.15, 0.0, 0.92)


def water_dispenser(s: RoomStyle, rng: np.random.Generator) -> Design:
    bottle = [(0.05, 0.0), (0.13, 0.05), (0.13, 0.3), (0.1, 0.34), (0.0, 0.34)]
    yield against_wall("water dispenser", 0.36, 0.36, 1.35, 0.5)
    yield box((-0.16, -0.34, 0.0), (0.16, -0.02, 1.0), WHITE, "-z +y")
    yield lathe(bottle, plain(rgb("8fc3df")), 12).placed(0.0, -0.18, 0.0, 1.0)
