"""What stands where in each room."""

from __future__ import annotations

from collections.abc import Callable

from anm_mj.scene.generation.furniture import clutter, decor, kitchen, seating, storage, tables
from anm_mj.scene.generation.furniture.quads import Material, Quads, join
from anm_mj.scene.generation.furniture.textures import (
    abstract,
    dots,
    fabric,
    landscape,
    plain,
    rgb,
    spots,
    stone,
    stripes,
    tiles,
    wood,
)
from anm_mj.scene.home.layout import Room, Side

_WHITE = plain(rgb("f4f1ea"), 0.01)
_OAK, _PINE, _WALNUT = wood(rgb("b98a56")), wood(rgb("dcb887")), wood(rgb("6e4a32"))
_METAL = plain(rgb("8f959c"))
_DARK = plain(rgb("2b2d31"))


def furnish(room: Room) -> Quads:
    """Everything that stands, lies or hangs in a room."""
    return join(*_FURNISHERS[room.name](room))


def _against(room: Room, side: Side, along_m: float, piece: Quads, gap_m: float = 0.015, z_m: float = 0.0) -> Quads:
    """A piece with its back to a wall; ``along_m`` is the world x or y of its middle, the gap clears the skirting."""
    (x0, y0), (x1, y1) = room.low_m, room.high_m
    x, y, yaw = {
        "north": (along_m, y1 - gap_m, 0.0),
        "south": (along_m, y0 + gap_m, 180.0),
        "west": (x0 + gap_m, along_m, 90.0),
        "east": (x1 - gap_m, along_m, -90.0),
    }[side]
    return piece.placed(x, y, yaw, z_m)


def _hang(room: Room, side: Side, along_m: float, piece: Quads) -> Quads:
    """A picture or the like on a wall."""
    return _against(room, side, along_m, piece, gap_m=0.0)


def _curtains(room: Room, cloth: Material) -> list[Quads]:
    """A curtain on either side of every window."""
    pieces = []
    for window in room.windows:
        for sign in (-1, 1):
            along = window.centre_m + sign * (window.width_m / 2 + 0.22)
            pieces.append(_hang(room, window.side, along, decor.curtain(0.3, 0.12, 2.3, cloth)))
    return pieces


def _living_room(room: Room) -> list[Quads]:
    blue = fabric(rgb("3f6c8f"))
    return [
        decor.rug_on_floor((2.5, 1.9), rgb("a8433d"), rgb("e3c58d"), rgb("2f4b6e")).placed(2.15, 2.1, 90.0),
        seating.sofa(2.1, blue, (fabric(rgb("e0a43a")), fabric(rgb("d9d2c3")), fabric(rgb("c4573c"))), _DARK).placed(
            3.55, 2.1, -90.0
        ),
        tables.table(1.0, 0.6, 0.42, _OAK, leg_m=0.04, shelf=True).placed(2.2, 2.1, 90.0),
        clutter.stack_of_books(3, 1).placed(2.15, 2.35, 25.0, 0.42),
        clutter.vase(rgb("e8e2d6"), 2).placed(2.25, 1.95, 0.0, 0.42),
        clutter.cup(rgb("c4573c")).placed(2.05, 1.75, 0.0, 0.42),
        clutter.stack_of_books(2, 5).placed(2.2, 2.3, 80.0, 0.16),
        _against(room, "west", 2.3, tables.chest(1.7, 0.42, 0.46, 1, _WALNUT, _WHITE)),
        _against(room, "west", 2.3, decor.television(1.15, abstract(4, 1.12, 0.62)).placed(0.0, -0.2), z_m=0.46),
        decor.plant(0.4, 9, plain(rgb("d6cfc0")), 3).placed(0.22, 3.0, 0.0, 0.46),
        _against(room, "north", 1.15, storage.bookcase(1.6, 2.0, 5, _OAK, 7)),
        _against(room, "north", 2.75, storage.bookcase(0.9, 1.2, 3, _OAK, 8)),
        clutter.vase(rgb("30638e"), 4).placed(2.95, 3.98, 0.0, 1.2),
        decor.table_lamp(rgb("ffe9b8"), plain(rgb("8c2f39"))).placed(2.55, 3.98, 0.0, 1.2),
        seating.sofa(0.95, fabric(rgb("b86f3c")), (fabric(rgb("efe3cc")),), _WALNUT).placed(1.0, 0.72, 145.0),
        decor.floor_lamp(rgb("ffe9b8")).placed(0.3, 3.55),
        decor.plant(1.5, 17, plain(rgb("c8553d")), 11).placed(5.34, 0.5),
        _against(room, "east", 3.05, tables.chest(1.3, 0.4, 0.8, 3, _OAK, _PINE)),
        decor.table_lamp(rgb("fff0cf"), plain(rgb("3b6b4f"))).placed(5.62, 3.5, 0.0, 0.8),
        clutter.bowl_of_fruit(plain(rgb("e9e4da"))).placed(5.62, 2.95, 0.0, 0.8),
        _hang(room, "east", 3.05, decor.picture(0.9, 0.6, 1.35, landscape(1, 0.9, 0.6), _WALNUT)),
        _hang(room, "north", 2.75, decor.picture(0.6, 0.45, 1.72, landscape(0, 0.6, 0.45), _DARK)),
        _hang(room, "west", 3.55, decor.picture(0.4, 0.55, 1.4, abstract(2, 0.4, 0.55), _OAK)),
        clutter.basket(0.2, 0.3, fabric(rgb("b08d57"), 0.3)).placed(4.25, 0.35),
        clutter.ball_on_floor(0.1, rgb("d1495b")).placed(4.75, 1.1),
        clutter.stack_of_books(4, 9).placed(2.9, 0.5, 10.0),
        *_curtains(room, stripes(rgb("d9b36c"), rgb("c79a4b"), 0.06)),
    ]


def _kitchen(room: Room) -> list[Quads]:
    front, top = plain(rgb("2f5f6e"), 0.04), stone(rgb("e4ded2"), rgb("8f8578"))
    chair_colours = ("d1495b", "edae49", "3f7d8c", "66a182")
    chairs = [
        seating.chair(_PINE, plain(rgb(code))).placed(x, y, yaw)
        for code, (x, y, yaw) in zip(
            chair_colours, ((7.75, 1.62, 180.0), (8.45, 1.7, 170.0), (7.75, 2.85, 5.0), (8.5, 2.95, -12.0)), strict=True
        )
    ]
    return [
        _against(room, "south", 9.35, kitchen.counter(2.1, front, top, oven_at_m=0.6)),
        _against(room, "south", 9.6, kitchen.sink(), z_m=0.9),
        _against(room, "south", 8.72, kitchen.wall_units(0.45, front)),
        _against(room, "south", 10.62, kitchen.wall_units(0.66, front)),
        _against(room, "east", 1.02, kitchen.counter(2.0, front, top)),
        _against(room, "south", 7.85, kitchen.fridge(plain(rgb("dfe3e6")))),
        clutter.bottle(rgb("3b6b4f")).placed(10.7, 0.35, 0.0, 0.9),
        clutter.bottle(rgb("8c5a2b")).placed(10.6, 0.5, 0.0, 0.9),
        clutter.cup(rgb("edae49")).placed(10.65, 1.3, 0.0, 0.9),
        clutter.cup(rgb("d1495b")).placed(10.75, 1.45, 0.0, 0.9),
        clutter.bowl_of_fruit(plain(rgb("30638e"))).placed(10.7, 1.8, 0.0, 0.9),
        tables.table(1.5, 0.85, 0.75, _PINE, leg_m=0.05).placed(8.1, 2.25),
        *chairs,
        clutter.vase(rgb("edae49"), 5).placed(8.1, 2.25, 0.0, 0.75),
        clutter.cup(rgb("f4f1de")).placed(7.7, 2.05, 0.0, 0.75),
        clutter.cup(rgb("3f7d8c")).placed(8.5, 2.45, 0.0, 0.75),
        _against(room, "west", 3.1, storage.bookcase(1.2, 1.9, 5, _PINE, 21)),
        _hang(room, "west", 0.5, decor.picture(0.5, 0.4, 1.4, abstract(9, 0.5, 0.4), _DARK)),
        _hang(room, "north", 9.6, decor.picture(0.9, 0.6, 1.25, landscape(3, 0.9, 0.6), _PINE)),
        decor.plant(1.0, 13, plain(rgb("e9e4da")), 12).placed(10.65, 3.8),
        clutter.basket(0.16, 0.42, _METAL).placed(10.05, 3.92),
        clutter.carton(0.36, 0.28, 0.24).placed(9.35, 3.88, 12.0),
        decor.rug_on_floor((1.3, 0.7), rgb("e0d3b8"), rgb("3f7d8c"), rgb("c8553d")).placed(9.3, 1.0),
    ]


def _hall(room: Room) -> list[Quads]:
    coats = (fabric(rgb("2f4b6e")), fabric(rgb("8c2f39")), fabric(rgb("6b7a4b")), fabric(rgb("d9a441")))
    return [
        decor.rug_on_floor((3.6, 0.7), rgb("3d5a4c"), rgb("d9c69a"), rgb("8c3b33")).placed(7.4, 4.85),
        _against(room, "south", 6.5, tables.chest(0.9, 0.28, 0.75, 2, _WALNUT, _OAK)),
        decor.table_lamp(rgb("ffe9b8"), _DARK).placed(6.25, 4.42, 0.0, 0.75),
        clutter.stack_of_books(2, 14).placed(6.75, 4.41, 5.0, 0.75),
        _hang(room, "south", 6.5, decor.picture(0.55, 0.7, 1.25, plain(rgb("c4d6dd"), 0.1), _WALNUT)),
        _hang(room, "south", 9.7, storage.coat_rack(1.3, _WALNUT, coats)),
        _hang(room, "east", 4.85, decor.front_door(wood(rgb("4f6b5a"), 0.15), _METAL)),
        clutter.pair_of_shoes(rgb("27374d")).placed(9.35, 4.45, 180.0),
        clutter.pair_of_shoes(rgb("8c5a2b")).placed(9.75, 4.43, 175.0),
        clutter.pair_of_shoes(rgb("d1495b")).placed(10.1, 4.46, 190.0),
        clutter.basket(0.11, 0.5, fabric(rgb("b08d57"), 0.3)).placed(10.82, 4.43),
        _hang(room, "north", 5.85, decor.picture(0.5, 0.4, 1.4, landscape(2, 0.5, 0.4), _DARK)),
        _hang(room, "north", 8.1, decor.picture(0.4, 0.5, 1.35, abstract(5, 0.4, 0.5), _OAK)),
        decor.plant(0.9, 11, plain(rgb("3f6c8f")), 15).placed(10.7, 5.17),
    ]


def _bedroom(room: Room) -> list[Quads]:
    linen = fabric(rgb("f1ece2"), 0.06)
    pillows = (fabric(rgb("dfe4f0")), fabric(rgb("dfe4f0")))
    return [
        decor.rug_on_floor((1.5, 2.3), rgb("cfc2dc"), rgb("6b5b95"), rgb("f1ece2")).placed(1.9, 6.45, 90.0),
        _against(room, "west", 6.45, tables.bed(1.6, _WALNUT, linen, fabric(rgb("6b5b95")), pillows)),
        _against(room, "west", 5.38, tables.chest(0.44, 0.38, 0.5, 2, _WALNUT, _WALNUT)),
        _against(room, "west", 7.52, tables.chest(0.44, 0.38, 0.5, 2, _WALNUT, _WALNUT)),
        decor.table_lamp(rgb("ffe0c2"), plain(rgb("d9d2c3"))).placed(0.2, 5.38, 0.0, 0.5),
        decor.table_lamp(rgb("ffe0c2"), plain(rgb("d9d2c3"))).placed(0.2, 7.55, 0.0, 0.5),
        clutter.stack_of_books(2, 17).placed(0.27, 7.42, 60.0, 0.5),
        _hang(room, "west", 6.45, decor.picture(1.0, 0.5, 1.35, landscape(2, 1.0, 0.5), _WALNUT)),
        _against(room, "south", 1.25, storage.wardrobe(2.0, 2.15, 0.58, _WALNUT, _OAK, _METAL)),
        _against(room, "east", 7.1, tables.chest(1.2, 0.45, 0.82, 3, _OAK, _WHITE)),
        _hang(room, "east", 7.1, decor.picture(0.7, 0.8, 1.1, plain(rgb("c4d6dd"), 0.1), _OAK)),
        clutter.vase(rgb("6b5b95"), 6).placed(3.62, 7.5, 0.0, 0.82),
        clutter.bottle(rgb("d98fb0")).placed(3.6, 6.85, 0.0, 0.82),
        seating.stool(_OAK, fabric(rgb("cfc2dc"))).placed(3.05, 7.1),
        decor.plant(1.25, 15, plain(rgb("8d9cc4")), 18).placed(3.44, 8.2),
        clutter.pair_of_shoes(rgb("d9a0b0")).placed(2.45, 5.75, 40.0),
        clutter.basket(0.2, 0.48, fabric(rgb("e0d3b8"), 0.2)).placed(0.3, 8.3),
        _hang(room, "south", 2.95, decor.picture(0.5, 0.7, 1.2, abstract(12, 0.5, 0.7), _DARK)),
        *_curtains(room, fabric(rgb("6f7fb0"))),
    ]


def _bathroom(room: Room) -> list[Quads]:
    towels = (fabric(rgb("e08a4e")), fabric(rgb("f4f1de")))
    return [
        _against(
            room,
            "north",
            4.95,
            kitchen.bathtub(1.97, 0.76, tiles(rgb("3f7d8c"), rgb("4c8b9a"), 0.1, rgb("e9f2f4"))),
            0.0,
        ),
        _against(room, "west", 7.25, kitchen.toilet()),
        _against(room, "east", 7.0, kitchen.basin(plain(rgb("3f7d8c"), 0.04)), 0.005),
        _against(room, "east", 5.95, kitchen.washing_machine()),
        _hang(room, "west", 6.35, kitchen.towel_rail(0.7, towels)),
        decor.rug_on_floor((0.8, 0.5), rgb("e08a4e"), rgb("f4f1de"), rgb("e08a4e")).placed(4.95, 7.42),
        clutter.basket(0.17, 0.45, fabric(rgb("c9b48a"), 0.3)).placed(4.17, 6.72),
        clutter.bottle(rgb("5aa9c9")).placed(5.8, 7.22, 0.0, 0.82),
        clutter.cup(rgb("f4f1de")).placed(5.8, 6.76, 0.0, 0.82),
        clutter.bottle(rgb("e5659d")).placed(5.85, 7.93, 0.0, 0.56),
    ]


def _study(room: Room) -> list[Quads]:
    return [
        decor.rug_on_floor((1.4, 1.1), rgb("d8cfae"), rgb("5a4632"), rgb("7fa088")).placed(7.25, 7.0),
        _against(room, "north", 7.2, tables.desk(1.7, 0.68, _OAK, _WHITE)),
        _against(room, "north", 7.1, decor.monitor(landscape(1, 0.57, 0.31)), z_m=0.74),
        decor.table_lamp(rgb("fff3c4"), _DARK).placed(7.9, 8.35, 0.0, 0.74),
        clutter.cup(rgb("30638e")).placed(6.62, 8.2, 0.0, 0.74),
        clutter.stack_of_books(4, 23).placed(6.5, 8.4, 8.0, 0.74),
        seating.office_chair(_DARK, fabric(rgb("3d405b"))).placed(7.2, 7.5, 160.0),
        _against(room, "west", 6.55, storage.bookcase(1.5, 2.1, 6, _WALNUT, 24)),
        _against(room, "east", 7.0, storage.bookcase(0.9, 1.1, 3, _WALNUT, 25)),
        decor.plant(0.45, 9, plain(rgb("e9e4da")), 26).placed(8.15, 7.25, 0.0, 1.1),
        decor.television(0.3, abstract(8, 0.27, 0.14)).placed(8.12, 6.85, -80.0, 1.1),
        _hang(room, "east", 7.0, decor.picture(0.8, 0.55, 1.65, spots(rgb("c79a63"), rgb("b5854e"), 0.4, 40.0), _OAK)),
        _hang(room, "west", 7.85, decor.picture(0.5, 0.65, 1.3, landscape(0, 0.5, 0.65), _DARK)),
        clutter.basket(0.15, 0.3, _METAL).placed(8.1, 7.72),
        clutter.carton(0.4, 0.32, 0.3).placed(8.08, 5.85, -6.0),
        clutter.carton(0.3, 0.26, 0.2).placed(8.1, 5.85, 14.0, 0.3),
    ]


def _childs_room(room: Room) -> list[Quads]:
    fills = tuple(plain(rgb(code)) for code in ("d1495b", "edae49", "00798c", "66a182", "8d5fa8"))
    quilt = dots(rgb("5aa9c9"), rgb("f4f1de"), 0.16, 0.045)
    return [
        decor.rug_on_floor((1.3, 1.3), rgb("f2c14e"), rgb("d1495b"), rgb("66a182")).placed(9.55, 7.0),
        _against(
            room, "north", 10.5, tables.bed(0.92, _PINE, fabric(rgb("f4f1de"), 0.06), quilt, (fabric(rgb("f2c14e")),))
        ),
        clutter.teddy(rgb("a9713f")).placed(10.62, 7.75, 20.0, 0.55),
        _against(room, "west", 7.3, storage.cubbies(4, 2, 0.36, _PINE, fills, 31)),
        clutter.toy_car(rgb("d1495b")).placed(8.62, 6.9, 80.0, 0.74),
        clutter.stack_of_books(3, 33).placed(8.63, 7.5, 90.0, 0.74),
        clutter.teddy(rgb("8a8f9c")).placed(8.62, 7.85, 90.0, 0.74),
        tables.table(0.6, 0.5, 0.48, _PINE, leg_m=0.035).placed(8.85, 6.15, 90.0),
        seating.stool(_PINE, plain(rgb("66a182"))).placed(8.72, 8.3),
        clutter.cup(rgb("8d5fa8")).placed(8.75, 6.1, 0.0, 0.48),
        clutter.toy_blocks(34).placed(9.55, 7.15),
        clutter.toy_car(rgb("00798c")).placed(9.95, 6.6, 30.0),
        seating.beanbag(fabric(rgb("d9683c"))).placed(10.5, 6.05),
        _hang(room, "east", 7.4, decor.picture(0.7, 0.5, 1.3, abstract(15, 0.7, 0.5), _PINE)),
        _hang(room, "west", 7.2, decor.picture(0.8, 0.55, 1.3, landscape(0, 0.8, 0.55), _PINE)),
        *_curtains(room, stripes(rgb("5aa9c9"), rgb("f4f1de"), 0.08)),
    ]


def _west_room(room: Room) -> list[Quads]:
    return [
        tables.table(1.0, 0.7, 0.74, _OAK).placed(1.9, 2.3),
        clutter.cup(rgb("d1495b")).placed(1.7, 2.2, 0.0, 0.74),
        _against(room, "west", 1.6, storage.bookcase(0.9, 1.8, 4, _WALNUT, 2)),
        _hang(room, "north", 1.5, decor.picture(0.8, 0.5, 1.3, landscape(1, 0.8, 0.5), _DARK)),
    ]


def _east_room(room: Room) -> list[Quads]:
    return [
        seating.sofa(1.5, fabric(rgb("3f6c8f")), (fabric(rgb("e0a43a")),), _DARK).placed(4.6, 0.5, 180.0),
        seating.chair(_PINE, plain(rgb("d1495b"))).placed(5.3, 2.4, 30.0),
        decor.plant(1.1, 9, plain(rgb("c8553d")), 3).placed(3.5, 2.6),
        _hang(room, "east", 1.5, decor.picture(0.6, 0.6, 1.3, abstract(2, 0.6, 0.6), _OAK)),
    ]


_FURNISHERS: dict[str, Callable[[Room], list[Quads]]] = {
    "living room": _living_room,
    "kitchen": _kitchen,
    "hall": _hall,
    "bedroom": _bedroom,
    "bathroom": _bathroom,
    "study": _study,
    "child's room": _childs_room,
    "west room": _west_room,
    "east room": _east_room,
}
