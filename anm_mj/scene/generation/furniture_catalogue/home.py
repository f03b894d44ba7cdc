"""Furniture catalogue: homes."""

from __future__ import annotations

import numpy as np

from anm_mj.scene.generation.furniture import clutter, decor, kitchen, seating, storage, tables
from anm_mj.scene.generation.piece import GAP_M, Piece, against_wall, in_corner, on_wall
from anm_mj.scene.generation.quads import Quads, box, join
from anm_mj.scene.generation.room_style import DARK, METAL, PORCELAIN, WHITE, RoomStyle
from anm_mj.scene.generation.textures import abstract, landscape, plain, rgb, stone, stripes, tiles


def sofa_group(width_m: float, s: RoomStyle, rng: np.random.Generator) -> Piece:
    """A sofa with a low table before it, a rug below."""
    pillows = (plain(s.colours[3]), plain(s.colours[4]), s.cloth_2)[: max(1, round(width_m / 0.8))]
    seed, books = int(rng.integers(1000)), int(rng.integers(2, 5))

    def make() -> Quads:
        return join(
            seating.sofa(width_m, s.cloth, pillows, DARK).placed(0.0, -0.47),
            tables.table(0.55 * width_m, 0.5, 0.42, s.wood, shelf=True).placed(0.0, -1.5),
            clutter.stack_of_books(books, seed).placed(-0.15 * width_m, -1.5, 25.0, 0.42),
            clutter.cup(s.colours[5]).placed(0.12 * width_m, -1.4, 0.0, 0.42),
            clutter.vase(s.colours[6], seed).placed(0.02, -1.6, 0.0, 0.42),
            decor.rug_on_floor((width_m - 0.1, 1.5), s.colours[0], s.colours[7], s.colours[3]).placed(0.0, -1.5),
        )

    solids = ((-width_m / 2, -0.93, width_m / 2, -0.015), (-0.28 * width_m, -1.75, 0.28 * width_m, -1.25))
    return Piece("sofa", "wall", solids, make, 0.5, 0.85)


def armchair(s: RoomStyle, rng: np.random.Generator) -> Piece:
    """A chair to sit back in."""
    cover = s.cloth_2 if rng.random() < 0.5 else s.cloth

    def make() -> Quads:
        return seating.sofa(0.95, cover, (s.cloth,), DARK).placed(0.0, -0.55, 12.0)

    return in_corner("armchair", 0.55, (0.05, 1.05), 0.85, make, front_m=0.4)


def television(s: RoomStyle, rng: np.random.Generator) -> Piece:
    """A low chest with a television on it."""
    width, seed = float(rng.uniform(1.3, 1.7)), int(rng.integers(1000))

    def make() -> Quads:
        return join(
            tables.chest(width, 0.42, 0.46, 1, s.wood_dark, WHITE),
            decor.television(1.1, abstract(seed, 1.07, 0.6)).placed(0.0, -0.2, 0.0, 0.46),
            decor.plant(0.35, 9, plain(s.colours[2]), seed).placed(width / 2 - 0.1, -0.2, 0.0, 0.46),
        )

    return against_wall("television", width, 0.45, 1.2, make)


def bookcase(s: RoomStyle, rng: np.random.Generator, high: bool = True) -> Piece:
    """Shelves with books, low ones with something on them."""
    width, seed = float(rng.uniform(0.8, 1.5)), int(rng.integers(1000))
    height = float(rng.uniform(1.8, 2.1)) if high else 1.1
    shelves = 5 if high else 3

    def make() -> Quads:
        pieces = [storage.bookcase(width, height, shelves, s.wood, seed)]
        if not high:
            pieces.append(clutter.vase(s.colours[4], seed).placed(-0.2, -0.14, 0.0, height))
            pieces.append(clutter.stack_of_books(3, seed).placed(0.15, -0.14, 10.0, height))
        return join(*pieces)

    return against_wall("bookcase", width, 0.28, height, make)


def drawers(s: RoomStyle, rng: np.random.Generator) -> Piece:
    """A chest of drawers with a lamp and small things."""
    width, rows, seed = float(rng.uniform(0.9, 1.4)), int(rng.integers(2, 4)), int(rng.integers(1000))
    height = 0.28 * rows + 0.1

    def make() -> Quads:
        return join(
            tables.chest(width, 0.42, height, rows, s.wood, s.paint if seed % 2 else WHITE),
            decor.table_lamp(rgb("ffe9b8"), plain(s.colours[5])).placed(-width / 2 + 0.18, -0.2, 0.0, height),
            clutter.bowl_of_fruit(plain(s.colours[3])).placed(0.1, -0.2, 0.0, height),
            clutter.stack_of_books(2, seed).placed(width / 2 - 0.2, -0.2, 15.0, height),
        )

    return against_wall("drawers", width, 0.44, height, make)


def bed(s: RoomStyle, rng: np.random.Generator, width_m: float) -> Piece:
    """A bed with its head to the wall and a small chest beside it, or two."""
    sides = (-1, 1) if width_m > 1.3 else (1,)
    seed = int(rng.integers(1000))

    def make() -> Quads:
        pillows = (WHITE, WHITE) if width_m > 1.3 else (WHITE,)
        pieces = [tables.bed(width_m, s.wood, plain(rgb("f1ece2"), 0.03), s.cloth, pillows).placed(0.0, -GAP_M)]
        for side in sides:
            x = side * (width_m / 2 + 0.3)
            pieces.append(tables.chest(0.44, 0.38, 0.5, 2, s.wood, s.wood).placed(x, -GAP_M))
            pieces.append(decor.table_lamp(rgb("ffe0c2"), plain(s.colours[6])).placed(x, -0.2, 0.0, 0.5))
        pieces.append(clutter.stack_of_books(2, seed).placed(sides[-1] * (width_m / 2 + 0.2), -0.27, 60.0, 0.5))
        if len(sides) == 2:
            # No wider than the bed and what stands beside it, so that it lies in the room wherever they fit.
            rug = decor.rug_on_floor((width_m + 0.8, 1.2), s.colours[1], s.colours[4], s.colours[8])
            pieces.append(rug.placed(0.0, -1.7))
        return join(*pieces)

    solids = [(-width_m / 2 - 0.02, -2.12, width_m / 2 + 0.02, -GAP_M)]
    solids += [(side * (width_m / 2 + 0.3) - 0.22, -0.4, side * (width_m / 2 + 0.3) + 0.22, -GAP_M) for side in sides]
    return Piece("bed", "wall", tuple(solids), make, 0.5, 0.9)


def couch_bed(s: RoomStyle) -> Piece:
    """A narrow bed with its side to the wall."""
    pillow = (plain(s.colours[3]),)

    def make() -> Quads:
        return tables.bed(0.9, s.wood, plain(rgb("f1ece2"), 0.03), s.cloth, pillow).placed(1.05, -0.47, -90.0)

    return Piece("bed", "wall", ((-1.07, -0.93, 1.07, -GAP_M),), make, 0.6, 0.9)


def wardrobe(s: RoomStyle, rng: np.random.Generator) -> Piece:
    """A closed wardrobe."""
    width = float(rng.choice([1.0, 1.5, 2.0]))
    return against_wall(
        "wardrobe", width, 0.62, 2.1, lambda: storage.wardrobe(width, 2.1, 0.58, s.wood_dark, s.wood, METAL), 0.7
    )


def desk(s: RoomStyle, rng: np.random.Generator) -> Piece:
    """A desk with a screen and a swivel chair."""
    width, seed = float(rng.uniform(1.3, 1.7)), int(rng.integers(1000))
    turn = float(rng.uniform(120.0, 240.0))

    def make() -> Quads:
        return join(
            tables.desk(width, 0.68, s.wood, WHITE).placed(0.0, -GAP_M),
            decor.monitor(landscape(seed, 0.57, 0.31)).placed(-0.1, -0.02, 0.0, 0.74),
            decor.table_lamp(rgb("fff3c4"), DARK).placed(width / 2 - 0.15, -0.2, 0.0, 0.74),
            clutter.cup(s.colours[4]).placed(-width / 2 + 0.15, -0.45, 0.0, 0.74),
            clutter.stack_of_books(3, seed).placed(-width / 2 + 0.22, -0.2, 8.0, 0.74),
            seating.office_chair(DARK, s.cloth).placed(-0.1, -0.85, turn),
        )

    solids = ((-width / 2, -0.7, width / 2, -GAP_M), (-0.42, -1.17, 0.22, -0.53))
    return Piece("desk", "wall", solids, make, 0.45, 0.8)


def dining(s: RoomStyle, rng: np.random.Generator, seats: int) -> Piece:
    """A table with chairs about it, pulled out a little."""
    width = 0.9 if seats == 2 else 1.3 if seats == 4 else 1.9
    depth, seed = 0.85, int(rng.integers(1000))
    per_side = max(1, seats // 2)
    places = [(-width / 2 + (k + 0.5) * width / per_side, side) for k in range(per_side) for side in (-1, 1)]
    pulled = [float(rng.uniform(0.02, 0.2)) for _ in places]
    turned = [float(rng.uniform(-12.0, 12.0)) for _ in places]
    colours = [s.colours[int(rng.integers(len(s.colours)))] for _ in places]

    def make() -> Quads:
        pieces = [tables.table(width, depth, 0.75, s.wood, leg_m=0.05)]
        for (x, side), out, turn, colour in zip(places, pulled, turned, colours, strict=True):
            yaw = (0.0 if side > 0 else 180.0) + turn
            pieces.append(seating.chair(s.wood_dark, plain(colour)).placed(x, side * (depth / 2 + 0.1 + out), yaw))
        pieces.append(clutter.vase(s.colours[3], seed).placed(0.0, 0.0, 0.0, 0.75))
        pieces.append(clutter.cup(s.colours[1]).placed(-0.3, 0.15, 0.0, 0.75))
        pieces.append(clutter.cup(s.colours[2]).placed(0.3, -0.2, 0.0, 0.75))
        return join(*pieces)

    solids = [(-width / 2, -depth / 2, width / 2, depth / 2)]
    for (x, side), out in zip(places, pulled, strict=True):
        y = side * (depth / 2 + 0.1 + out)
        solids.append((x - 0.25, y - 0.25, x + 0.25, y + 0.25))
    return Piece("dining table", "middle", tuple(solids), make, 0.5, 0.9)


def kitchen_counter(s: RoomStyle, rng: np.random.Generator, width_m: float) -> Piece:
    """Worktop with oven and sink, cupboards above, things lying about, a fridge at its end."""
    top = stone(rgb("e4ded2"), rgb("8f8578"))
    total = width_m + 0.65

    def make() -> Quads:
        x = -0.325
        return join(
            kitchen.counter(width_m, s.paint, top, oven_at_m=-width_m / 4).placed(x),
            kitchen.sink().placed(x + width_m / 4, 0.0, 0.0, 0.9),
            kitchen.wall_units(0.45 * width_m, s.paint).placed(x - 0.25 * width_m),
            kitchen.fridge(plain(rgb("dfe3e6"))).placed(total / 2 - 0.31),
            clutter.bottle(s.colours[2]).placed(x - width_m / 2 + 0.12, -0.15, 0.0, 0.9),
            clutter.bottle(s.colours[7]).placed(x - width_m / 2 + 0.22, -0.12, 0.0, 0.9),
            clutter.cup(s.colours[3]).placed(x + width_m / 2 - 0.2, -0.3, 0.0, 0.9),
            clutter.bowl_of_fruit(plain(s.colours[0])).placed(x, -0.3, 0.0, 0.9),
        ).placed(0.0, -GAP_M)

    solids = ((-total / 2, -0.65, total / 2 - 0.62, 0.0), (total / 2 - 0.64, -0.71, total / 2, 0.0))
    return Piece("kitchen counter", "wall", solids, make, 0.8, 1.8)


def worktop(s: RoomStyle, rng: np.random.Generator, width_m: float) -> Piece:
    """Worktop with oven and sink, low enough for below a window."""
    top = stone(rgb("e4ded2"), rgb("8f8578"))

    def make() -> Quads:
        return join(
            kitchen.counter(width_m, s.paint, top, oven_at_m=-width_m / 4),
            kitchen.sink().placed(width_m / 4, 0.0, 0.0, 0.9),
            clutter.bottle(s.colours[2]).placed(-width_m / 2 + 0.12, -0.15, 0.0, 0.9),
            clutter.cup(s.colours[3]).placed(0.0, -0.3, 0.0, 0.9),
        ).placed(0.0, -GAP_M)

    return Piece("worktop", "wall", ((-width_m / 2, -0.65, width_m / 2, 0.0),), make, 0.7, 0.9)


def bathtub(s: RoomStyle, rng: np.random.Generator) -> Piece:
    """A tub with tiles before it."""
    apron = tiles(s.colours[0], s.colours[0], 0.1, rgb("e9f2f4"))
    width = float(rng.uniform(1.5, 1.75))

    def make() -> Quads:
        ends = [
            box((x - 0.01, -0.72, 0.0), (x + 0.01, 0.0, 0.53), apron, "-z")
            for x in (-width / 2 + 0.01, width / 2 - 0.01)
        ]
        return join(kitchen.bathtub(width - 0.01, 0.74, apron), *ends)

    return against_wall("bathtub", width, 0.76, 0.8, make, 0.5)


def toilet() -> Piece:
    """A toilet."""
    return against_wall("toilet", 0.46, 0.66, 0.82, kitchen.toilet, 0.5)


def basin(s: RoomStyle) -> Piece:
    """A wash-basin with a mirror."""

    def make() -> Quads:
        return join(
            kitchen.basin(s.paint),
            clutter.bottle(s.colours[4]).placed(-0.25, -0.12, 0.0, 0.82),
            clutter.cup(rgb("f4f1de")).placed(0.24, -0.12, 0.0, 0.82),
        )

    return against_wall("basin", 0.74, 0.48, 1.9, make, 0.6)


def washing_machine() -> Piece:
    """A washing machine."""
    return against_wall("washing machine", 0.6, 0.6, 0.85, kitchen.washing_machine, 0.6)


def cubbies(s: RoomStyle, rng: np.random.Generator) -> Piece:
    """A low shelf of boxes and toys."""
    seed = int(rng.integers(1000))

    def make() -> Quads:
        return join(
            storage.cubbies(4, 2, 0.36, s.wood, tuple(plain(colour) for colour in s.colours[:5]), seed),
            clutter.teddy(rgb("a9713f")).placed(0.45, -0.15, 0.0, 0.74),
            clutter.toy_car(s.colours[0]).placed(-0.2, -0.16, 70.0, 0.74),
        )

    return against_wall("cubbies", 1.46, 0.34, 0.74, make)


def plant(s: RoomStyle, rng: np.random.Generator) -> Piece:
    """A plant in a pot on the floor."""
    height, seed, leaves = float(rng.uniform(0.9, 1.5)), int(rng.integers(1000)), int(rng.integers(11, 18))
    reach = 0.1 + 0.3 * height

    def make() -> Quads:
        return decor.plant(height, leaves, plain(s.colours[4]), seed).placed(0.0, -reach)

    return in_corner("plant", reach, (0.0, 2 * reach), height, make)


def floor_lamp() -> Piece:
    """A lamp on a thin pole."""
    return in_corner("floor lamp", 0.2, (0.02, 0.42), 1.6, lambda: decor.floor_lamp(rgb("ffe9b8")).placed(0.0, -0.22))


def basket(s: RoomStyle, rng: np.random.Generator) -> Piece:
    """A basket or bin."""
    radius, height = float(rng.uniform(0.13, 0.2)), float(rng.uniform(0.3, 0.5))

    def make() -> Quads:
        return clutter.basket(radius, height, s.cloth_2).placed(0.0, -radius - 0.03)

    return in_corner("basket", radius, (0.03, 2 * radius + 0.03), height, make)


def cartons(rng: np.random.Generator) -> Piece:
    """Cardboard boxes on one another."""
    w, d, turn = float(rng.uniform(0.36, 0.5)), float(rng.uniform(0.3, 0.4)), float(rng.uniform(-15.0, 15.0))
    half = 0.56 * max(w, d)

    def make() -> Quads:
        return join(
            clutter.carton(w, d, 0.32).placed(0.0, -half, turn),
            clutter.carton(0.75 * w, 0.75 * d, 0.22).placed(0.02, -half, -turn, 0.32),
        )

    return in_corner("cartons", half, (0.0, 2 * half), 0.6, make)


def shoes(s: RoomStyle) -> Piece:
    """A pair of shoes by the wall."""

    def make() -> Quads:
        return clutter.pair_of_shoes(s.colours[2]).placed(0.0, -0.18)

    return Piece("shoes", "wall", ((-0.13, -0.33, 0.15, -0.02),), make, 0.0, 0.12)


def toys(s: RoomStyle, rng: np.random.Generator) -> Piece:
    """Building blocks, a car and a ball on the floor."""
    seed = int(rng.integers(1000))

    def make() -> Quads:
        return join(
            clutter.toy_blocks(seed),
            clutter.toy_car(s.colours[1]).placed(0.35, -0.3, 30.0),
            clutter.ball_on_floor(0.1, s.colours[0]).placed(-0.35, 0.28),
        )

    return Piece("toys", "middle", ((-0.47, -0.45, 0.5, 0.4),), make, 0.0, 0.2)


def beanbag(s: RoomStyle) -> Piece:
    """A soft seat."""
    return in_corner("beanbag", 0.43, (0.02, 0.88), 0.6, lambda: seating.beanbag(s.cloth_2).placed(0.0, -0.45))


def chair(s: RoomStyle) -> Piece:
    """A chair by the wall."""

    def make() -> Quads:
        return seating.chair(s.wood, s.paint).placed(0.0, -0.24)

    return Piece("chair", "wall", ((-0.22, -0.45, 0.22, -0.02),), make, 0.3, 0.9)


def stool(s: RoomStyle) -> Piece:
    """A stool with three thin legs."""
    return in_corner("stool", 0.2, (0.02, 0.42), 0.46, lambda: seating.stool(s.wood, s.cloth).placed(0.0, -0.22))


def hall_table(s: RoomStyle, rng: np.random.Generator) -> Piece:
    """A narrow chest with a lamp."""
    seed = int(rng.integers(1000))

    def make() -> Quads:
        return join(
            tables.chest(0.9, 0.28, 0.75, 2, s.wood_dark, s.wood),
            decor.table_lamp(rgb("ffe9b8"), plain(s.colours[3])).placed(-0.25, -0.14, 0.0, 0.75),
            clutter.stack_of_books(2, seed).placed(0.22, -0.15, 5.0, 0.75),
        )

    return against_wall("hall table", 0.9, 0.31, 0.75, make, 0.75)


def coat_rack(s: RoomStyle, rng: np.random.Generator) -> Piece:
    """Coats on hooks."""
    coats = (s.cloth, s.cloth_2, plain(s.colours[7]), plain(s.colours[9]))[: int(rng.integers(2, 5))]
    width = 0.36 * len(coats)
    solids = ((-width / 2 - 0.02, -0.15, width / 2 + 0.02, 0.0),)
    return Piece("coat rack", "wall", solids, lambda: storage.coat_rack(width, s.wood_dark, coats), 0.75, 1.74)


def rug(s: RoomStyle, size_m: tuple[float, float]) -> Piece:
    """A carpet in the middle."""
    x, y = size_m[0] / 2, size_m[1] / 2

    def make() -> Quads:
        return decor.rug_on_floor(size_m, s.colours[1], s.colours[6], s.colours[3])

    return Piece("rug", "rug", ((-x, -y, x, y),), make, 0.0, 0.01)


def picture(s: RoomStyle, rng: np.random.Generator) -> Piece:
    """A painting."""
    width, height, seed = float(rng.uniform(0.4, 1.0)), float(rng.uniform(0.4, 0.65)), int(rng.integers(1000))
    image = landscape(seed, width, height) if rng.random() < 0.5 else abstract(seed, width, height)
    return on_wall(
        "picture", width / 2 + 0.05, 0.03, 2.1, lambda: decor.picture(width, height, 1.4, image, s.wood_dark)
    )


def towels(s: RoomStyle) -> Piece:
    """Towels on a rail."""
    return on_wall("towels", 0.37, 0.09, 1.3, lambda: kitchen.towel_rail(0.7, (s.cloth, s.cloth_2)))


def curtains(s: RoomStyle, rng: np.random.Generator, window_m: float) -> Piece:
    """A curtain on either side of a window."""
    cloth = stripes(s.colours[3], s.colours[5], 0.07) if rng.random() < 0.5 else s.cloth_2
    reach = window_m / 2 + 0.2

    def make() -> Quads:
        return join(*(decor.curtain(0.3, 0.12, 2.3, cloth).placed(side * reach) for side in (-1, 1)))

    solids = ((-reach - 0.16, -0.1, -reach + 0.16, 0.0), (reach - 0.16, -0.1, reach + 0.16, 0.0))
    return Piece("curtains", "window", solids, make, 0.0, 2.3)


def porcelain_shelf() -> Piece:
    """A board with bottles."""

    def make() -> Quads:
        return join(
            storage.wall_shelf(0.6, 1.25, PORCELAIN),
            clutter.bottle(rgb("5aa9c9")).placed(-0.15, -0.1, 0.0, 1.28),
            clutter.bottle(rgb("e5659d")).placed(0.1, -0.1, 0.0, 1.28),
        )

    return on_wall("shelf", 0.3, 0.2, 1.6, make)
