"""Furniture catalogue: homes. Each function draws one piece of a room's style, its sizes by chance."""

import math

import numpy as np

from anm_mj.scene.generation.furniture import clutter, decor, standing
from anm_mj.scene.generation.piece import GAP_M, Design, Piece, against_wall, in_corner, on_wall
from anm_mj.scene.generation.quads import box, cushion, cylinder, grid_quads, join, lathe
from anm_mj.scene.generation.room_style import DARK, METAL, WHITE, RoomStyle
from anm_mj.scene.generation.textures import abstract, glow, landscape, plain, rgb, stripes


def sofa_group(s: RoomStyle, rng: np.random.Generator, width_m: float) -> Design:
    pillows = (plain(s.colours[3]), plain(s.colours[4]), s.cloth_2)[: max(1, round(width_m / 0.8))]
    seed, books = int(rng.integers(1000)), int(rng.integers(2, 5))
    solids = ((-width_m / 2, -0.93, width_m / 2, -0.015), (-0.28 * width_m, -1.75, 0.28 * width_m, -1.25))
    yield Piece("sofa", "wall", solids, 0.5, 0.85)
    yield standing.sofa(width_m, s.cloth, pillows, DARK).placed(0.0, -0.47)
    yield standing.table(0.55 * width_m, 0.5, 0.42, s.wood, shelf=True).placed(0.0, -1.5)
    yield clutter.stack_of_books(books, seed).placed(-0.15 * width_m, -1.5, 25.0, 0.42)
    yield clutter.cup(s.colours[5]).placed(0.12 * width_m, -1.4, 0.0, 0.42)
    yield clutter.vase(s.colours[6], seed).placed(0.02, -1.6, 0.0, 0.42)
    yield decor.rug_on_floor((width_m - 0.1, 1.5), s.colours[0], s.colours[7], s.colours[3]).placed(0.0, -1.5)


def armchair(s: RoomStyle, rng: np.random.Generator) -> Design:
    cover = s.cloth_2 if rng.random() < 0.5 else s.cloth
    yield in_corner("armchair", 0.55, (0.05, 1.05), 0.85, front_m=0.4)
    yield standing.sofa(0.95, cover, (s.cloth,), DARK).placed(0.0, -0.55, 12.0)


def television(s: RoomStyle, rng: np.random.Generator) -> Design:
    width, seed = float(rng.uniform(1.3, 1.7)), int(rng.integers(1000))
    yield against_wall("television", width, 0.45, 1.2)
    yield standing.chest(width, 0.42, 0.46, 1, s.wood_dark, WHITE)
    yield decor.television(1.1, abstract(seed, 1.07, 0.6)).placed(0.0, -0.2, 0.0, 0.46)
    yield decor.plant(0.35, 9, plain(s.colours[2]), seed).placed(width / 2 - 0.1, -0.2, 0.0, 0.46)


def bookcase(s: RoomStyle, rng: np.random.Generator) -> Design:
    width, seed, height = float(rng.uniform(0.8, 1.5)), int(rng.integers(1000)), float(rng.uniform(1.8, 2.1))
    yield against_wall("bookcase", width, 0.28, height)
    yield standing.bookcase(width, height, 5, s.wood, seed)


def low_bookcase(s: RoomStyle, rng: np.random.Generator) -> Design:
    width, seed, height = float(rng.uniform(0.8, 1.5)), int(rng.integers(1000)), 1.1
    yield against_wall("bookcase", width, 0.28, height)
    yield standing.bookcase(width, height, 3, s.wood, seed)
    yield clutter.vase(s.colours[4], seed).placed(-0.2, -0.14, 0.0, height)
    yield clutter.stack_of_books(3, seed).placed(0.15, -0.14, 10.0, height)


def drawers(s: RoomStyle, rng: np.random.Generator) -> Design:
    width, rows, seed = float(rng.uniform(0.9, 1.4)), int(rng.integers(2, 4)), int(rng.integers(1000))
    height = 0.28 * rows + 0.1
    yield against_wall("drawers", width, 0.44, height)
    yield standing.chest(width, 0.42, height, rows, s.wood, s.paint if seed % 2 else WHITE)
    yield decor.table_lamp(rgb("ffe9b8"), plain(s.colours[5])).placed(-width / 2 + 0.18, -0.2, 0.0, height)
    yield clutter.bowl_of_fruit(plain(s.colours[3])).placed(0.1, -0.2, 0.0, height)
    yield clutter.stack_of_books(2, seed).placed(width / 2 - 0.2, -0.2, 15.0, height)


def bed(s: RoomStyle, rng: np.random.Generator, width_m: float) -> Design:
    sides, pillows = ((-1, 1), (WHITE, WHITE)) if width_m > 1.3 else ((1,), (WHITE,))
    seed = int(rng.integers(1000))
    solids = [(-width_m / 2 - 0.02, -2.12, width_m / 2 + 0.02, -GAP_M)]
    solids += [(side * (width_m / 2 + 0.3) - 0.22, -0.4, side * (width_m / 2 + 0.3) + 0.22, -GAP_M) for side in sides]
    yield Piece("bed", "wall", tuple(solids), 0.5, 0.9)
    yield standing.bed(width_m, s.wood, plain(rgb("f1ece2"), 0.03), s.cloth, pillows).placed(0.0, -GAP_M)
    for side in sides:
        x = side * (width_m / 2 + 0.3)
        yield standing.chest(0.44, 0.38, 0.5, 2, s.wood, s.wood).placed(x, -GAP_M)
        yield decor.table_lamp(rgb("ffe0c2"), plain(s.colours[6])).placed(x, -0.2, 0.0, 0.5)
    yield clutter.stack_of_books(2, seed).placed(sides[-1] * (width_m / 2 + 0.2), -0.27, 60.0, 0.5)
    if len(sides) == 2:
        # No wider than the bed and what stands beside it, so that it lies in the room wherever they fit.
        yield decor.rug_on_floor((width_m + 0.8, 1.2), s.colours[1], s.colours[4], s.colours[8]).placed(0.0, -1.7)


def couch_bed(s: RoomStyle, rng: np.random.Generator) -> Design:
    yield Piece("bed", "wall", ((-1.07, -0.93, 1.07, -GAP_M),), 0.6, 0.9)
    bed = standing.bed(0.9, s.wood, plain(rgb("f1ece2"), 0.03), s.cloth, (plain(s.colours[3]),))
    yield bed.placed(1.05, -0.47, -90.0)


def wardrobe(s: RoomStyle, rng: np.random.Generator) -> Design:
    width = float(rng.choice([1.0, 1.5, 2.0]))
    yield against_wall("wardrobe", width, 0.62, 2.1, 0.7)
    yield standing.wardrobe(width, 2.1, 0.58, s.wood_dark, s.wood, METAL)


def desk(s: RoomStyle, rng: np.random.Generator) -> Design:
    width, seed = float(rng.uniform(1.3, 1.7)), int(rng.integers(1000))
    turn = float(rng.uniform(120.0, 240.0))
    yield Piece("desk", "wall", ((-width / 2, -0.7, width / 2, -GAP_M), (-0.42, -1.17, 0.22, -0.53)), 0.45, 0.8)
    yield standing.desk(width, 0.68, s.wood, WHITE).placed(0.0, -GAP_M)
    yield decor.monitor(landscape(seed, 0.57, 0.31)).placed(-0.1, -0.02, 0.0, 0.74)
    yield decor.table_lamp(rgb("fff3c4"), DARK).placed(width / 2 - 0.15, -0.2, 0.0, 0.74)
    yield clutter.cup(s.colours[4]).placed(-width / 2 + 0.15, -0.45, 0.0, 0.74)
    yield clutter.stack_of_books(3, seed).placed(-width / 2 + 0.22, -0.2, 8.0, 0.74)
    yield standing.office_chair(DARK, s.cloth).placed(-0.1, -0.85, turn)


def dining(s: RoomStyle, rng: np.random.Generator, seats: int) -> Design:
    width = 0.9 if seats == 2 else 1.3 if seats == 4 else 1.9
    depth, seed = 0.85, int(rng.integers(1000))
    per_side = max(1, seats // 2)
    places = [(-width / 2 + (k + 0.5) * width / per_side, side) for k in range(per_side) for side in (-1, 1)]
    pulled = [float(rng.uniform(0.02, 0.2)) for _ in places]
    turned = [float(rng.uniform(-12.0, 12.0)) for _ in places]
    colours = [s.colours[int(rng.integers(len(s.colours)))] for _ in places]
    solids = [(-width / 2, -depth / 2, width / 2, depth / 2)]
    for (x, side), out in zip(places, pulled, strict=True):
        y = side * (depth / 2 + 0.1 + out)
        solids.append((x - 0.25, y - 0.25, x + 0.25, y + 0.25))
    yield Piece("dining table", "middle", tuple(solids), 0.5, 0.9)
    yield standing.table(width, depth, 0.75, s.wood, leg_m=0.05)
    for (x, side), out, turn, colour in zip(places, pulled, turned, colours, strict=True):
        yaw = (0.0 if side > 0 else 180.0) + turn
        yield standing.chair(s.wood_dark, plain(colour)).placed(x, side * (depth / 2 + 0.1 + out), yaw)
    yield clutter.vase(s.colours[3], seed).placed(0.0, 0.0, 0.0, 0.75)
    yield clutter.cup(s.colours[1]).placed(-0.3, 0.15, 0.0, 0.75)
    yield clutter.cup(s.colours[2]).placed(0.3, -0.2, 0.0, 0.75)


def cubbies(s: RoomStyle, rng: np.random.Generator) -> Design:
    seed = int(rng.integers(1000))
    yield against_wall("cubbies", 1.46, 0.34, 0.74)
    columns, rows, cell, wall, depth = range(4), range(2), 0.36, 0.02, 0.32
    shelf_rng, fills = np.random.default_rng(seed), [plain(colour) for colour in s.colours[:5]]
    x, height = (4 * cell + wall) / 2, 2 * cell + wall
    yield box((-x, -0.012, 0.0), (x, 0.0, height), s.wood, "-z +y -x +x +z")
    for k in range(5):
        left = -x + k * cell
        yield box((left, -depth, 0.0), (left + wall, -0.012, height), s.wood, "-z +y")
    for k in range(3):
        for column in columns:
            left, z = -x + column * cell + wall, k * cell
            yield box((left, -depth, z), (left + cell - wall, -0.012, z + wall), s.wood, "-x +x +y")
    for row in rows:
        for column in columns:
            if shelf_rng.random() >= 0.25:
                left, z = -x + column * cell + wall + 0.012, row * cell + wall
                high = (left + cell - wall - 0.024, -0.03, z + cell * shelf_rng.uniform(0.55, 0.85))
                yield box((left, -depth + 0.015, z), high, fills[shelf_rng.integers(5)], "-z +y")
    yield clutter.teddy(rgb("a9713f")).placed(0.45, -0.15, 0.0, 0.74)
    yield clutter.toy_car(s.colours[0]).placed(-0.2, -0.16, 70.0, 0.74)


def plant(s: RoomStyle, rng: np.random.Generator) -> Design:
    height, seed, leaves = float(rng.uniform(0.9, 1.5)), int(rng.integers(1000)), int(rng.integers(11, 18))
    reach = 0.1 + 0.3 * height
    yield in_corner("plant", reach, (0.0, 2 * reach), height)
    yield decor.plant(height, leaves, plain(s.colours[4]), seed).placed(0.0, -reach)


def floor_lamp(s: RoomStyle, rng: np.random.Generator) -> Design:
    yield in_corner("floor lamp", 0.2, (0.02, 0.42), 1.6)
    yield join(
        lathe([(0.15, 0.0), (0.15, 0.025), (0.02, 0.035)], DARK, 14),
        cylinder(0.013, 0.03, 1.4, DARK, 8),
        lathe([(0.0, 1.36), (0.2, 1.36), (0.14, 1.62), (0.0, 1.62)], glow(rgb("ffe9b8")), 16),
    ).placed(0.0, -0.22)


def basket(s: RoomStyle, rng: np.random.Generator) -> Design:
    radius, height = float(rng.uniform(0.13, 0.2)), float(rng.uniform(0.3, 0.5))
    yield in_corner("basket", radius, (0.03, 2 * radius + 0.03), height)
    inner = radius - 0.015
    profile = [(0.8 * radius, 0.0), (radius, height), (inner, height), (0.78 * inner, 0.03), (0.0, 0.03)]
    yield lathe(profile, s.cloth_2, 14).placed(0.0, -radius - 0.03)


def cartons(s: RoomStyle, rng: np.random.Generator) -> Design:
    w, d, turn = float(rng.uniform(0.36, 0.5)), float(rng.uniform(0.3, 0.4)), float(rng.uniform(-15.0, 15.0))
    half = 0.56 * max(w, d)
    yield in_corner("cartons", half, (0.0, 2 * half), 0.6)
    yield clutter.carton(w, d, 0.32).placed(0.0, -half, turn)
    yield clutter.carton(0.75 * w, 0.75 * d, 0.22).placed(0.02, -half, -turn, 0.32)


def shoes(s: RoomStyle, rng: np.random.Generator) -> Design:
    yield Piece("shoes", "wall", ((-0.13, -0.33, 0.15, -0.02),), 0.0, 0.12)
    leather = plain(s.colours[2])
    shoe = join(
        box((-0.045, -0.14, 0.0), (0.045, 0.13, 0.02), plain(rgb("efe9df")), "-z"),
        cushion((-0.043, -0.135, 0.01), (0.043, 0.125, 0.075), 0.03, leather, "-z"),
        cushion((-0.038, 0.0, 0.05), (0.038, 0.12, 0.12), 0.02, leather, "-z", segments=1),
    )
    yield join(shoe.placed(-0.06), shoe.placed(0.07, 0.03, 9.0)).placed(0.0, -0.18)


def toys(s: RoomStyle, rng: np.random.Generator) -> Design:
    seed = int(rng.integers(1000))
    yield Piece("toys", "middle", ((-0.47, -0.45, 0.5, 0.4),), 0.0, 0.2)
    block_rng = np.random.default_rng(seed)
    colours = [plain(rgb(code)) for code in ("d1495b", "edae49", "00798c", "66a182", "8d5fa8")]
    blocks = [box((-0.03, -0.03, 0.0), (0.03, 0.03, 0.06), colour, "-z") for colour in colours]
    for k in range(7):
        x, y = block_rng.uniform(-0.22, 0.22, 2)
        yield blocks[k % 5].placed(x, y, block_rng.uniform(0, 90))
    for k in range(3):
        yield blocks[1].placed(0.3, 0.1, 15.0 * k, 0.06 * k)
    yield clutter.toy_car(s.colours[1]).placed(0.35, -0.3, 30.0)
    latitudes = np.linspace(-math.pi / 2, math.pi / 2, 11)
    profile = [(0.1 * math.cos(a), 0.1 * (1.0 + math.sin(a))) for a in latitudes]
    skin, belt = plain(s.colours[0]), plain(rgb("f4f1de"))
    for part, look in ((profile[:5], skin), (profile[4:7], belt), (profile[6:], skin)):
        yield lathe(part, look, 16).placed(-0.35, 0.28)


def beanbag(s: RoomStyle, rng: np.random.Generator) -> Design:
    yield in_corner("beanbag", 0.43, (0.02, 0.88), 0.6)
    half = [(0.0, 0.0), (0.3, 0.0), (0.41, 0.1), (0.42, 0.2), (0.34, 0.36), (0.18, 0.5), (0.06, 0.58), (0.0, 0.59)]
    yield lathe(half, s.cloth_2, 16).placed(0.0, -0.45)


def chair(s: RoomStyle, rng: np.random.Generator) -> Design:
    yield Piece("chair", "wall", ((-0.22, -0.45, 0.22, -0.02),), 0.3, 0.9)
    yield standing.chair(s.wood, s.paint).placed(0.0, -0.24)


def stool(s: RoomStyle, rng: np.random.Generator) -> Design:
    yield in_corner("stool", 0.2, (0.02, 0.42), 0.46)
    yield standing.stool(s.wood, s.cloth).placed(0.0, -0.22)


def hall_table(s: RoomStyle, rng: np.random.Generator) -> Design:
    seed = int(rng.integers(1000))
    yield against_wall("hall table", 0.9, 0.31, 0.75, 0.75)
    yield standing.chest(0.9, 0.28, 0.75, 2, s.wood_dark, s.wood)
    yield decor.table_lamp(rgb("ffe9b8"), plain(s.colours[3])).placed(-0.25, -0.14, 0.0, 0.75)
    yield clutter.stack_of_books(2, seed).placed(0.22, -0.15, 5.0, 0.75)


def coat_rack(s: RoomStyle, rng: np.random.Generator) -> Design:
    coats = (s.cloth, s.cloth_2, plain(s.colours[7]), plain(s.colours[9]))[: int(rng.integers(2, 5))]
    width = 0.36 * len(coats)
    yield Piece("coat rack", "wall", ((-width / 2 - 0.02, -0.15, width / 2 + 0.02, 0.0),), 0.75, 1.74)
    x = width / 2
    yield box((-x, -0.025, 1.62), (x, 0.0, 1.74), s.wood_dark, "+y")
    for k, coat in enumerate(coats):
        middle, length = -x + (k + 0.5) * width / len(coats), 0.75 + 0.12 * (k % 2)
        yield box((middle - 0.17, -0.02 - 0.09, 1.62 - length), (middle + 0.17, -0.02, 1.62), coat, "+y")
        yield box((middle - 0.2, -0.02 - 0.11, 1.35), (middle + 0.2, -0.02, 1.5), coat, "+y -z +z")


def rug(s: RoomStyle, rng: np.random.Generator, width_m: float, depth_m: float) -> Design:
    yield Piece("rug", "rug", ((-width_m / 2, -depth_m / 2, width_m / 2, depth_m / 2),), 0.0, 0.01)
    yield decor.rug_on_floor((width_m, depth_m), s.colours[1], s.colours[6], s.colours[3])


def picture(s: RoomStyle, rng: np.random.Generator) -> Design:
    width, height, seed = float(rng.uniform(0.4, 1.0)), float(rng.uniform(0.4, 0.65)), int(rng.integers(1000))
    image = landscape(seed, width, height) if rng.random() < 0.5 else abstract(seed, width, height)
    yield on_wall("picture", width / 2 + 0.05, 0.03, 2.1)
    yield decor.picture(width, height, 1.4, image, s.wood_dark)


def curtains(s: RoomStyle, rng: np.random.Generator, window_m: float) -> Design:
    cloth = stripes(s.colours[3], s.colours[5], 0.07) if rng.random() < 0.5 else s.cloth_2
    reach = window_m / 2 + 0.2
    solids = ((-reach - 0.16, -0.1, -reach + 0.16, 0.0), (reach - 0.16, -0.1, reach + 0.16, 0.0))
    yield Piece("curtains", "window", solids, 0.0, 2.3)
    low, high, folds = 0.12, 2.3, 9
    front = np.stack([np.linspace(-0.15, 0.15, folds), -0.06 - 0.025 * np.cos(np.arange(folds) * math.pi)], axis=-1)
    outline = np.concatenate([front, front[::-1] + np.array([0.0, 0.012]), front[:1]])
    points = np.stack([np.insert(outline, 2, z, axis=1) for z in (low, high)])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(outline, axis=0), axis=1))])
    uv = np.stack(np.broadcast_arrays(along[None, :], np.array([[low], [high]])), axis=-1)
    for side in (-1, 1):
        yield grid_quads(points, uv, cloth).placed(side * reach)
