"""Room types: their sizes, and which ones a building of a given number of rooms has."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class RoomType:
    """What the layout has to know about a type of room."""

    area_m2: tuple[float, float]
    """Smallest and largest area it is given."""
    private: bool = False
    """True if no way leads through it to another room, as for a bathroom."""


ROOM_TYPES = {
    "living": RoomType((19.0, 28.0)),
    "kitchen": RoomType((10.0, 15.0)),
    "dining": RoomType((11.0, 16.0)),
    "bedroom": RoomType((11.0, 17.0)),
    "child": RoomType((9.0, 13.0)),
    "study": RoomType((8.0, 12.0)),
    "bathroom": RoomType((5.0, 8.0), private=True),
    "storage": RoomType((4.5, 8.0), private=True),
    "library": RoomType((10.0, 16.0)),
    "hobby": RoomType((10.0, 15.0)),
    "corridor": RoomType((0.0, 0.0)),
    "reception": RoomType((16.0, 24.0)),
    "open office": RoomType((30.0, 46.0)),
    "office": RoomType((10.0, 17.0)),
    "meeting": RoomType((15.0, 24.0)),
    "break room": RoomType((13.0, 20.0)),
    "washroom": RoomType((6.0, 9.0), private=True),
    "archive": RoomType((7.0, 12.0), private=True),
    "lounge": RoomType((14.0, 22.0)),
    "laboratory": RoomType((18.0, 28.0)),
}

_APARTMENT = ("living", "bedroom", "kitchen", "bathroom", "child", "study", "dining", "storage")
_APARTMENT_MORE = (
    "bedroom", "bathroom", "study", "living", "library", "child", "kitchen", "hobby", "bedroom", "storage",
)  # fmt: skip
_OFFICE = ("open office", "office", "meeting", "break room", "office", "washroom", "reception", "office", "archive")
_OFFICE_MORE = ("office", "office", "meeting", "laboratory", "office", "lounge", "open office", "office", "washroom")


def choose_room_types(num: int, kind: str, rng: np.random.Generator) -> list[str]:
    """Types of ``num`` rooms, corridors apart: first what every home or office has, then more in no fixed order."""
    base, more = (_APARTMENT, _APARTMENT_MORE) if kind == "apartment" else (_OFFICE, _OFFICE_MORE)
    room_types: list[str] = list(base[:num])
    while len(room_types) < num:
        room_types += [more[k] for k in rng.permutation(len(more))[: num - len(room_types)]]
    return room_types
