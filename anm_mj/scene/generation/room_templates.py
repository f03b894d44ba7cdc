"""Room templates: the furniture of each room type, the most important first."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from anm_mj.scene.generation.furniture_catalogue import home, office
from anm_mj.scene.generation.furniture_catalogue import kitchen_and_bath as wet
from anm_mj.scene.generation.piece import Design, Piece, drawn
from anm_mj.scene.generation.room_style import RoomStyle

_Draw = Callable[[RoomStyle, np.random.Generator], Design]

_SOFA = (partial(home.sofa_group, width_m=2.1), partial(home.sofa_group, width_m=1.6), home.armchair)
_TABLE_2 = (partial(home.dining, seats=2),)
_TABLE_4 = (partial(home.dining, seats=4), *_TABLE_2)
_TABLE_6 = (partial(home.dining, seats=6), *_TABLE_4)
_BED = (partial(home.bed, width_m=1.6), partial(home.bed, width_m=1.0), home.couch_bed)
_CHILD_BED = (partial(home.bed, width_m=0.95), home.couch_bed)
_COUNTER = (
    *(partial(wet.kitchen_counter, width_m=width) for width in (2.4, 1.8, 1.2)),
    *(partial(wet.worktop, width_m=width) for width in (2.4, 1.5, 1.0)),
)
"""A row with a fridge, or one that fits below a window."""
_PICTURES_2, _PICTURES_3 = 2 * (home.picture,), 3 * (home.picture,)


def pieces_for(room_type: str, area_m2: float, style: RoomStyle, rng: np.random.Generator) -> list[tuple[Piece, ...]]:
    """Pieces for a room, the most important first; of each tuple, the first that fits is taken.

    A type without a template is furnished like a lounge.
    """
    return [
        tuple(drawn(draw(style, rng)) for draw in (choice if isinstance(choice, tuple) else (choice,)))
        for choice in _template(room_type, area_m2, rng)
    ]


def _template(room_type: str, area_m2: float, rng: np.random.Generator) -> Iterator[_Draw | tuple[_Draw, ...]]:
    match room_type:
        case "living":
            yield from (_SOFA, home.television, home.bookcase)
            yield from (_TABLE_4, home.armchair) if area_m2 > 20 else ()
            yield from (home.drawers, home.plant, home.floor_lamp, home.low_bookcase, home.basket, *_PICTURES_3)
        case "kitchen":
            yield from (_COUNTER, _TABLE_4, home.bookcase)
            yield from (home.drawers,) if area_m2 > 14 else ()
            yield from (home.plant, home.basket, home.cartons, home.picture, home.picture)
        case "dining":
            yield from (_TABLE_6, home.drawers, home.low_bookcase, home.plant, home.floor_lamp, home.chair)
            yield from _PICTURES_3
        case "bedroom":
            yield from (_BED, home.wardrobe, home.drawers)
            yield from (home.desk,) if area_m2 > 15 else ()
            yield from (home.plant, home.stool, home.basket, home.shoes, home.picture, home.picture)
        case "child":
            yield from (_CHILD_BED, home.cubbies, home.toys, home.beanbag)
            yield from (home.desk,) if area_m2 > 11 else ()
            yield from (home.wardrobe, home.stool, partial(home.rug, width_m=1.3, depth_m=1.3), *_PICTURES_2)
        case "study":
            yield from (home.desk, home.bookcase, home.low_bookcase, home.armchair, home.plant, home.basket)
            yield from (home.cartons, partial(home.rug, width_m=1.5, depth_m=1.1), home.picture, home.picture)
        case "library":
            yield from (home.armchair, *4 * (home.bookcase,), _SOFA, home.floor_lamp, home.plant, home.picture)
        case "hobby":
            yield from (_TABLE_2, home.desk, office.racks, home.cubbies, home.cartons, home.cartons, home.beanbag)
            yield from (home.stool, home.picture, home.picture)
        case "bathroom":
            yield from (wet.toilet, wet.basin, wet.bathtub, wet.washing_machine, wet.towels, home.basket)
            yield from (wet.bottle_shelf, partial(home.rug, width_m=0.8, depth_m=0.5))
        case "washroom":
            yield from (wet.toilet, wet.basin, wet.toilet, wet.basin, wet.towels, home.basket, wet.bottle_shelf)
        case "storage":
            yield from (office.racks, wet.washing_machine, home.wardrobe, office.racks, home.cartons, home.cartons)
            yield from (home.basket, home.stool)
        case "corridor":
            yield from (home.coat_rack, home.hall_table, home.shoes, home.shoes, home.plant)
            yield from min(8, 2 + int(area_m2 / 8)) * (home.picture,)
        case "office corridor":
            yield from (office.water_dispenser, office.filing, home.chair, home.plant, home.plant, home.basket)
            yield from min(8, 2 + int(area_m2 / 8)) * (home.picture,)
        case "office":
            one_island = area_m2 > 13 and rng.random() < 0.5
            yield from (partial(office.desk_island, per_side=1),) if one_island else (home.desk, home.desk)
            yield from (home.bookcase, office.filing, office.whiteboard, home.plant, home.chair, home.basket)
            yield from (home.cartons, home.picture)
        case "open office":
            for _ in range(max(1, round(area_m2 / 14))):
                most = int(rng.integers(1, 4))
                yield tuple(partial(office.desk_island, per_side=num) for num in range(most, 0, -1))
            yield from (office.filing, office.whiteboard, home.bookcase, office.copier, home.plant, home.plant)
            yield from (home.basket, home.desk, home.cartons, home.picture, home.picture)
        case "meeting":
            yield tuple(partial(office.meeting_table, seats=seats) for seats in (8 if area_m2 > 17 else 6, 4))
            yield from (office.whiteboard, home.television, home.drawers, home.plant, home.basket, *_PICTURES_2)
        case "break room":
            yield from (_COUNTER, _TABLE_4, _TABLE_2, _SOFA, office.water_dispenser, home.plant, home.basket)
            yield from _PICTURES_2
        case "reception":
            yield from (office.reception_desk, _SOFA, home.armchair, home.plant, home.plant, office.water_dispenser)
            yield from (home.chair, *_PICTURES_3)
        case "laboratory":
            yield from (office.laboratory_island, office.laboratory_bench, office.laboratory_bench, office.lockers)
            yield from (office.racks, office.whiteboard, home.cartons, home.basket)
        case "archive":
            yield from (office.racks, office.racks, office.racks, office.filing, office.lockers)
            yield from (home.cartons, home.cartons, home.stool)
        case _:
            yield from (_SOFA, home.armchair, _TABLE_2, home.bookcase)
            yield from (_SOFA, _TABLE_4, partial(office.desk_island, per_side=2), _TABLE_4) if area_m2 > 40 else ()
            yield from (home.plant, home.plant, home.floor_lamp, home.television, home.drawers, *_PICTURES_3)
