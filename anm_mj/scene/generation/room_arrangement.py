"""Room types, and arrangements of rectangular rooms: clusters, and rows of rooms along corridors."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from anm_mj.scene.generation.wall import between

ROOM_AREAS_M2 = {
    "living": (19.0, 28.0), "kitchen": (10.0, 15.0), "dining": (11.0, 16.0), "bedroom": (11.0, 17.0),
    "child": (9.0, 13.0), "study": (8.0, 12.0), "bathroom": (5.0, 8.0), "storage": (4.5, 8.0),
    "library": (10.0, 16.0), "hobby": (10.0, 15.0), "corridor": (0.0, 0.0), "reception": (16.0, 24.0),
    "open office": (30.0, 46.0), "office": (10.0, 17.0), "meeting": (15.0, 24.0), "break room": (13.0, 20.0),
    "washroom": (6.0, 9.0), "archive": (7.0, 12.0), "lounge": (14.0, 22.0), "laboratory": (18.0, 28.0),
}  # fmt: skip
"""Smallest and largest area that the layout gives to each type of room [m2]."""
PRIVATE = {"bathroom", "storage", "washroom", "archive"}
"""Rooms that no way leads through to another."""

_APARTMENT = ("living", "bedroom", "kitchen", "bathroom", "child", "study", "dining", "storage")
_APARTMENT_MORE = (
    "bedroom", "bathroom", "study", "living", "library", "child", "kitchen", "hobby", "bedroom", "storage",
)  # fmt: skip
_OFFICE = ("open office", "office", "meeting", "break room", "office", "washroom", "reception", "office", "archive")
_OFFICE_MORE = ("office", "office", "meeting", "laboratory", "office", "lounge", "open office", "office", "washroom")

_ROUND_M = 0.05
"""Walls stand on multiples of this [m]."""
_ROOMS_PER_CORRIDOR = 13
_MIN_WIDTH_M = 2.1

_Place = tuple[float, float]


@dataclass(frozen=True)
class Cell:
    """A rectangle between the middles of its walls [m]."""

    room_type: str
    low_m: _Place
    high_m: _Place

    @property
    def area_m2(self) -> float:
        """Its area [m2]."""
        return (self.high_m[0] - self.low_m[0]) * (self.high_m[1] - self.low_m[1])


def choose_room_types(num: int, kind: str, rng: np.random.Generator) -> list[str]:
    """Types of ``num`` rooms, corridors apart: first what every home or office has, then more in no fixed order."""
    base, more = (_APARTMENT, _APARTMENT_MORE) if kind == "apartment" else (_OFFICE, _OFFICE_MORE)
    room_types: list[str] = list(base[:num])
    while len(room_types) < num:
        room_types += [more[k] for k in rng.permutation(len(more))[: num - len(room_types)]]
    return room_types


def cluster(room_types: list[str], rng: np.random.Generator) -> list[Cell]:
    """Rooms that adjoin one another without a corridor: a rectangle, halved again and again."""
    areas = np.array([rng.uniform(*ROOM_AREAS_M2[room_type]) for room_type in room_types])
    order = rng.permutation(len(room_types))
    ratio = rng.uniform(1.1, 1.5)
    width = float(np.sqrt(areas.sum() * ratio))
    high = _round(width), _round(width / ratio)
    return list(_halved([room_types[k] for k in order], areas[order], (0.0, 0.0), high, rng))


def _halved(
    room_types: list[str], areas: np.ndarray, low: _Place, high: _Place, rng: np.random.Generator
) -> Iterator[Cell]:
    """A rectangle, split across its longer side until every part is one room."""
    if len(room_types) == 1:
        yield Cell(room_types[0], low, high)
        return
    num = max(1, min(len(room_types) - 1, round(len(room_types) / 2 + float(rng.uniform(-0.4, 0.4)))))
    share = float(areas[:num].sum() / areas.sum())
    axis = 0 if high[0] - low[0] >= high[1] - low[1] else 1
    span = high[axis] - low[axis]
    least = min(_MIN_WIDTH_M, span / 2)
    cut = _round(low[axis] + float(np.clip(share * span, least, span - least)))
    first_high = (cut, high[1]) if axis == 0 else (high[0], cut)
    second_low = (cut, low[1]) if axis == 0 else (low[0], cut)
    yield from _halved(room_types[:num], areas[:num], low, first_high, rng)
    yield from _halved(room_types[num:], areas[num:], second_low, high, rng)


def wings(num_rooms: int, kind: str, room_types: list[str], rng: np.random.Generator) -> list[Cell]:
    """Rows of rooms on both sides of corridors, which cross corridors join where there are several.

    ``num_rooms`` counts corridors and is at least 4; of ``room_types``, those that do not find a place are left out.
    Offices have deeper rooms and wider corridors than apartments.
    """
    office = kind == "office"
    num_corridors = max(1, round(num_rooms / _ROOMS_PER_CORRIDOR))
    num_links = 0 if num_corridors == 1 else 2
    room_types = room_types[: num_rooms - num_corridors - num_links * (num_corridors - 1)]
    corridor_m = _round(float(rng.uniform(1.75, 2.2) if office else rng.uniform(1.25, 1.5)))
    # With one corridor, the largest room may close its end and be as deep as the whole building.
    head = None
    if num_corridors == 1 and len(room_types) >= 4 and rng.random() < 0.65:
        head = max(room_types, key=lambda room_type: ROOM_AREAS_M2[room_type][1])
        room_types.remove(head)

    rows = _dealt(room_types, 2 * num_corridors, rng)
    depths = [_round(float(rng.uniform(4.2, 5.4) if office else rng.uniform(3.4, 4.4))) for _ in rows]
    lengths = [sum(area for _, area in row) / depth for row, depth in zip(rows, depths, strict=True)]
    shortest = max(len(row) for row in rows) * _MIN_WIDTH_M
    length = _round(max(float(np.mean(lengths)), shortest) + num_links * corridor_m)

    cells: list[Cell] = []
    links: list[float] = []
    y, y_link = 0.0, 0.0
    for corridor in range(num_corridors):
        south, north = 2 * corridor, 2 * corridor + 1
        low = _round(y + depths[south])
        high = _round(low + corridor_m)
        top = _round(high + depths[north])
        is_last = corridor == num_corridors - 1
        cells += [Cell("corridor", (x, y_link), (_round(x + corridor_m), low)) for x in links]
        cells += _row(rows[south], length, (y, low), links, corridor_m, "" if corridor else "south", rng)
        cells.append(Cell("corridor", (0.0, low), (length, high)))
        links = [] if is_last else _link_places(length, corridor_m, rng)
        cells += _row(rows[north], length, (high, top), links, corridor_m, "north" if is_last else "", rng)
        y, y_link = top, high
    if head is not None:
        width = _round(max(3.4, float(rng.uniform(*ROOM_AREAS_M2[head])) / y))
        cells.append(Cell(head, (-width, 0.0), (0.0, y)))
    return cells


def _dealt(room_types: list[str], num_rows: int, rng: np.random.Generator) -> list[list[tuple[str, float]]]:
    rooms = [(room_type, float(rng.uniform(*ROOM_AREAS_M2[room_type]))) for room_type in room_types]
    rows: list[list[tuple[str, float]]] = [[] for _ in range(num_rows)]
    for room_type, area in sorted(rooms, key=lambda room: -room[1]):
        # A row without a room would leave a corridor without a wall.
        min(rows, key=lambda row: sum(a for _, a in row)).append((room_type, area))
    return [[row[k] for k in rng.permutation(len(row))] for row in rows]


def _link_places(length_m: float, corridor_m: float, rng: np.random.Generator) -> list[float]:
    """Where cross corridors begin: one at an end or near it, the other far from it."""
    first = 0.0 if rng.random() < 0.6 else _round(float(rng.uniform(0.15, 0.25)) * length_m)
    last = length_m - corridor_m
    second = last if rng.random() < 0.5 else _round(float(rng.uniform(0.6, 0.75)) * length_m)
    return [first, _round(second)]


def _row(
    rooms: list[tuple[str, float]],
    length_m: float,
    y_m: tuple[float, float],
    links_m: list[float],
    corridor_m: float,
    facade: str,
    rng: np.random.Generator,
) -> list[Cell]:
    """Rooms side by side between the cross corridors; on a facade some stand out a little."""
    between_links = between(((x, _round(x + corridor_m)) for x in links_m), length_m)
    stretches = [(a, b) for a, b in between_links if b - a >= _MIN_WIDTH_M]
    counts = _shares([b - a for a, b in stretches], len(rooms))
    cells, taken = [], 0
    for (a, b), count in zip(stretches, counts, strict=True):
        group = rooms[taken : taken + count]
        taken += count
        areas = np.array([area for _, area in group])
        # Every room is wide enough, the rest goes by area.
        spare = b - a - count * _MIN_WIDTH_M
        widths = _MIN_WIDTH_M + spare * areas / areas.sum() if spare > 0 else np.full(count, (b - a) / max(count, 1))
        cuts = [_round(a + float(x)) for x in np.concatenate([[0.0], np.cumsum(widths)])]
        for (room_type, _), left, right in zip(group, cuts[:-1], cuts[1:], strict=True):
            out = _round(float(rng.choice([0.0, 0.0, 0.4, 0.8]))) if facade else 0.0
            low = y_m[0] - (out if facade == "south" else 0.0)
            high = y_m[1] + (out if facade == "north" else 0.0)
            cells.append(Cell(room_type, (left, low), (right, high)))
    return cells


def _shares(lengths_m: list[float], num: int) -> list[int]:
    """``num`` rooms spread over stretches by length, none of which stays empty while there are rooms."""
    counts = [0] * len(lengths_m)
    for _ in range(num):
        counts[int(np.argmax([length / (count + 0.5) for length, count in zip(lengths_m, counts, strict=True)]))] += 1
    return counts


def _round(value_m: float) -> float:
    return round(round(value_m / _ROUND_M) * _ROUND_M, 4)
