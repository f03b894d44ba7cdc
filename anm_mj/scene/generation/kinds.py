"""Kinds of rooms: how large they are, and which a building of so many rooms has."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class RoomKind:
    """What the layout has to know about a kind of room."""

    area_m2: tuple[float, float]
    """Smallest and largest area it is given."""
    private: bool = False
    """True if no way leads through it to another room, as for a bathroom."""


KINDS = {
    "living": RoomKind((19.0, 28.0)),
    "kitchen": RoomKind((10.0, 15.0)),
    "dining": RoomKind((11.0, 16.0)),
    "bedroom": RoomKind((11.0, 17.0)),
    "child": RoomKind((9.0, 13.0)),
    "study": RoomKind((8.0, 12.0)),
    "bathroom": RoomKind((5.0, 8.0), private=True),
    "storage": RoomKind((4.5, 8.0), private=True),
    "library": RoomKind((10.0, 16.0)),
    "hobby": RoomKind((10.0, 15.0)),
    "corridor": RoomKind((0.0, 0.0)),
    "reception": RoomKind((16.0, 24.0)),
    "open office": RoomKind((30.0, 46.0)),
    "office": RoomKind((10.0, 17.0)),
    "meeting": RoomKind((15.0, 24.0)),
    "break room": RoomKind((13.0, 20.0)),
    "washroom": RoomKind((6.0, 9.0), private=True),
    "archive": RoomKind((7.0, 12.0), private=True),
    "lounge": RoomKind((14.0, 22.0)),
    "laboratory": RoomKind((18.0, 28.0)),
}
"""All kinds that can be furnished."""

_APARTMENT = ("living", "bedroom", "kitchen", "bathroom", "child", "study", "dining", "storage")
_APARTMENT_MORE = (
    "bedroom",
    "bathroom",
    "study",
    "living",
    "library",
    "child",
    "kitchen",
    "hobby",
    "bedroom",
    "storage",
)
_OFFICE = ("open office", "office", "meeting", "break room", "office", "washroom", "reception", "office", "archive")
_OFFICE_MORE = ("office", "office", "meeting", "laboratory", "office", "lounge", "open office", "office", "washroom")


def choose_kinds(num: int, style: str, rng: np.random.Generator) -> list[str]:
    """Kinds of ``num`` rooms, corridors apart: first what every home or office has, then more in no fixed order."""
    base, more = (_APARTMENT, _APARTMENT_MORE) if style == "apartment" else (_OFFICE, _OFFICE_MORE)
    kinds: list[str] = list(base[:num])
    while len(kinds) < num:
        kinds += [more[k] for k in rng.permutation(len(more))[: num - len(kinds)]]
    return kinds
