"""Room templates: the furniture of each room type, the most important first."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from anm_mj.scene.generation.furniture_catalogue import home, office
from anm_mj.scene.generation.piece import Piece
from anm_mj.scene.generation.room_style import RoomStyle

Choice = Piece | tuple[Piece, ...]
"""A piece, or several of which the first that fits is taken."""
Choices = list[Choice]


def pieces_for(room_type: str, area_m2: float, style: RoomStyle, rng: np.random.Generator) -> Choices:
    """Pieces for a room, the most important first; a type without a template is furnished like a lounge."""
    return _TEMPLATES.get(room_type, _lounge)(area_m2, style, rng)


def _living(area: float, s: RoomStyle, rng: np.random.Generator) -> Choices:
    pieces = [_sofa(s, rng), home.television(s, rng), home.bookcase(s, rng)]
    if area > 20:
        pieces += [_table(s, rng, 4), home.armchair(s, rng)]
    pieces += [home.drawers(s, rng), home.plant(s, rng), home.floor_lamp(), home.bookcase(s, rng, high=False)]
    return [*pieces, home.basket(s, rng), *_pictures(3, s, rng)]


def _kitchen(area: float, s: RoomStyle, rng: np.random.Generator) -> Choices:
    pieces = [*_cooking(s, rng), _table(s, rng, 4), home.bookcase(s, rng)]
    if area > 14:
        pieces.append(home.drawers(s, rng))
    return [*pieces, home.plant(s, rng), home.basket(s, rng), home.cartons(rng), *_pictures(2, s, rng)]


def _cooking(s: RoomStyle, rng: np.random.Generator) -> Choices:
    """What makes a room a kitchen: a row with a fridge, or one that fits below a window."""
    rows = tuple(home.kitchen_counter(s, rng, width) for width in (2.4, 1.8, 1.2))
    return [(*rows, home.worktop(s, rng, 2.4), home.worktop(s, rng, 1.5), home.worktop(s, rng, 1.0))]


def _table(s: RoomStyle, rng: np.random.Generator, seats: int) -> tuple[Piece, ...]:
    """A table for so many, or for fewer."""
    return tuple(home.dining(s, rng, num) for num in range(seats, 1, -2))


def _sofa(s: RoomStyle, rng: np.random.Generator) -> tuple[Piece, ...]:
    """A sofa as long as there is room for, or an armchair."""
    return home.sofa_group(2.1, s, rng), home.sofa_group(1.6, s, rng), home.armchair(s, rng)


def _dining(area: float, s: RoomStyle, rng: np.random.Generator) -> Choices:
    pieces = [_table(s, rng, 6), home.drawers(s, rng), home.bookcase(s, rng, high=False)]
    return [*pieces, home.plant(s, rng), home.floor_lamp(), home.chair(s), *_pictures(3, s, rng)]


def _bedroom(area: float, s: RoomStyle, rng: np.random.Generator) -> Choices:
    pieces = [
        (home.bed(s, rng, 1.6), home.bed(s, rng, 1.0), home.couch_bed(s)),
        home.wardrobe(s, rng),
        home.drawers(s, rng),
    ]
    if area > 15:
        pieces.append(home.desk(s, rng))
    return [*pieces, home.plant(s, rng), home.stool(s), home.basket(s, rng), home.shoes(s), *_pictures(2, s, rng)]


def _child(area: float, s: RoomStyle, rng: np.random.Generator) -> Choices:
    pieces = [(home.bed(s, rng, 0.95), home.couch_bed(s)), home.cubbies(s, rng), home.toys(s, rng), home.beanbag(s)]
    pieces += [home.desk(s, rng)] if area > 11 else []
    return [*pieces, home.wardrobe(s, rng), home.stool(s), home.rug(s, (1.3, 1.3)), *_pictures(2, s, rng)]


def _study(area: float, s: RoomStyle, rng: np.random.Generator) -> Choices:
    pieces = [home.desk(s, rng), home.bookcase(s, rng), home.bookcase(s, rng, high=False)]
    pieces += [home.armchair(s, rng), home.plant(s, rng), home.basket(s, rng), home.cartons(rng)]
    return [*pieces, home.rug(s, (1.5, 1.1)), *_pictures(2, s, rng)]


def _library(area: float, s: RoomStyle, rng: np.random.Generator) -> Choices:
    pieces = [home.armchair(s, rng), *(home.bookcase(s, rng) for _ in range(4)), _sofa(s, rng)]
    return [*pieces, home.floor_lamp(), home.plant(s, rng), *_pictures(1, s, rng)]


def _hobby(area: float, s: RoomStyle, rng: np.random.Generator) -> Choices:
    pieces = [_table(s, rng, 2), home.desk(s, rng), office.racks(s, rng), home.cubbies(s, rng)]
    return [*pieces, home.cartons(rng), home.cartons(rng), home.beanbag(s), home.stool(s), *_pictures(2, s, rng)]


def _bathroom(area: float, s: RoomStyle, rng: np.random.Generator) -> Choices:
    pieces = [home.toilet(), home.basin(s), home.bathtub(s, rng), home.washing_machine(), home.towels(s)]
    return [*pieces, home.basket(s, rng), home.porcelain_shelf(), home.rug(s, (0.8, 0.5))]


def _washroom(area: float, s: RoomStyle, rng: np.random.Generator) -> Choices:
    pieces = [home.toilet(), home.basin(s), home.toilet(), home.basin(s), home.towels(s), home.basket(s, rng)]
    return [*pieces, home.porcelain_shelf()]


def _storage(area: float, s: RoomStyle, rng: np.random.Generator) -> Choices:
    pieces = [office.racks(s, rng), home.washing_machine(), home.wardrobe(s, rng), office.racks(s, rng)]
    return [*pieces, home.cartons(rng), home.cartons(rng), home.basket(s, rng), home.stool(s)]


def _corridor(area: float, s: RoomStyle, rng: np.random.Generator) -> Choices:
    pieces = [home.coat_rack(s, rng), home.hall_table(s, rng), home.shoes(s), home.shoes(s), home.plant(s, rng)]
    return [*pieces, *_pictures(min(8, 2 + int(area / 8)), s, rng)]


def _office_corridor(area: float, s: RoomStyle, rng: np.random.Generator) -> Choices:
    pieces = [office.water_dispenser(), office.filing(s, rng), home.chair(s), home.plant(s, rng), home.plant(s, rng)]
    return [*pieces, home.basket(s, rng), *_pictures(min(8, 2 + int(area / 8)), s, rng)]


def _office(area: float, s: RoomStyle, rng: np.random.Generator) -> Choices:
    one_island = area > 13 and rng.random() < 0.5
    first = [office.desk_island(s, rng, 1)] if one_island else [home.desk(s, rng), home.desk(s, rng)]
    pieces = [*first, home.bookcase(s, rng), office.filing(s, rng), office.whiteboard(rng), home.plant(s, rng)]
    return [*pieces, home.chair(s), home.basket(s, rng), home.cartons(rng), *_pictures(1, s, rng)]


def _open_office(area: float, s: RoomStyle, rng: np.random.Generator) -> Choices:
    islands = [
        tuple(office.desk_island(s, rng, num) for num in range(int(rng.integers(1, 4)), 0, -1))
        for _ in range(max(1, round(area / 14)))
    ]
    pieces = [*islands, office.filing(s, rng), office.whiteboard(rng), home.bookcase(s, rng), office.copier()]
    pieces += [home.plant(s, rng), home.plant(s, rng), home.basket(s, rng), home.desk(s, rng), home.cartons(rng)]
    return [*pieces, *_pictures(2, s, rng)]


def _meeting(area: float, s: RoomStyle, rng: np.random.Generator) -> Choices:
    seats = 8 if area > 17 else 6
    pieces = [
        (office.meeting_table(s, rng, seats), office.meeting_table(s, rng, 4)),
        office.whiteboard(rng),
        home.television(s, rng),
        home.drawers(s, rng),
    ]
    return [*pieces, home.plant(s, rng), home.basket(s, rng), *_pictures(2, s, rng)]


def _break_room(area: float, s: RoomStyle, rng: np.random.Generator) -> Choices:
    pieces = [*_cooking(s, rng), _table(s, rng, 4), _table(s, rng, 2), _sofa(s, rng)]
    return [*pieces, office.water_dispenser(), home.plant(s, rng), home.basket(s, rng), *_pictures(2, s, rng)]


def _reception(area: float, s: RoomStyle, rng: np.random.Generator) -> Choices:
    pieces = [office.reception_desk(s, rng), _sofa(s, rng), home.armchair(s, rng), home.plant(s, rng)]
    return [*pieces, home.plant(s, rng), office.water_dispenser(), home.chair(s), *_pictures(3, s, rng)]


def _laboratory(area: float, s: RoomStyle, rng: np.random.Generator) -> Choices:
    pieces = [office.laboratory_island(s, rng), office.laboratory_bench(s, rng), office.laboratory_bench(s, rng)]
    rest = [office.lockers(s), office.racks(s, rng), office.whiteboard(rng), home.cartons(rng), home.basket(s, rng)]
    return [*pieces, *rest]


def _archive(area: float, s: RoomStyle, rng: np.random.Generator) -> Choices:
    pieces = [*(office.racks(s, rng) for _ in range(3)), office.filing(s, rng), office.lockers(s)]
    return [*pieces, home.cartons(rng), home.cartons(rng), home.stool(s)]


def _lounge(area: float, s: RoomStyle, rng: np.random.Generator) -> Choices:
    pieces = [_sofa(s, rng), home.armchair(s, rng), _table(s, rng, 2), home.bookcase(s, rng)]
    if area > 40:
        pieces += [_sofa(s, rng), _table(s, rng, 4), office.desk_island(s, rng, 2), _table(s, rng, 4)]
    pieces += [home.plant(s, rng), home.plant(s, rng), home.floor_lamp(), home.television(s, rng), home.drawers(s, rng)]
    return [*pieces, *_pictures(3, s, rng)]


def _pictures(num: int, s: RoomStyle, rng: np.random.Generator) -> list[Piece]:
    return [home.picture(s, rng) for _ in range(num)]


_TEMPLATES: dict[str, Callable[[float, RoomStyle, np.random.Generator], Choices]] = {
    "living": _living,
    "kitchen": _kitchen,
    "dining": _dining,
    "bedroom": _bedroom,
    "child": _child,
    "study": _study,
    "library": _library,
    "hobby": _hobby,
    "bathroom": _bathroom,
    "washroom": _washroom,
    "storage": _storage,
    "corridor": _corridor,
    "office corridor": _office_corridor,
    "office": _office,
    "open office": _open_office,
    "meeting": _meeting,
    "break room": _break_room,
    "reception": _reception,
    "laboratory": _laboratory,
    "archive": _archive,
    "lounge": _lounge,
}
