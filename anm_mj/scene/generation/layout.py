"""Generates layouts: rooms, doors that connect them all, and loops."""

from typing import Literal

import numpy as np
import shapely

from anm_mj.errors import SceneError
from anm_mj.scene.generation.building import Building, Passage, named_rooms
from anm_mj.scene.generation.room_arrangement import PRIVATE, Cell, choose_room_types, cluster, wings

BuildingKind = Literal["apartment", "office"]

MIN_ROOMS, MAX_ROOMS = 1, 60
WALL_M = 0.12
"""Thickness of the walls between rooms."""
_DOOR_WIDTHS_M = (0.8, 0.85, 0.9, 0.95, 1.0)
_WIDE_M = (1.3, 1.9)
"""Narrowest and widest opening that is not a door."""
_CLOSED = PRIVATE | {"bedroom", "child"}
"""Rooms that are never open to others."""
_DOOR_MARGIN_M = 0.2
"""Doors keep this far from corners: room for the frame."""
_MAX_ATTEMPTS = 20


def plan_building(rooms: int, seed: int, kind: BuildingKind = "apartment") -> Building:
    """The rooms and doors of a building of 1 to 60 rooms, corridors counted; the same for the same arguments.

    All rooms can be reached; from five rooms on there is at least one loop. ``seed`` is 0 or more. Raises SceneError if
    an argument is out of its range.
    """
    if not MIN_ROOMS <= rooms <= MAX_ROOMS:
        raise SceneError(f"A building of {rooms} rooms cannot be generated: give {MIN_ROOMS} to {MAX_ROOMS}.")
    if seed < 0:
        raise SceneError(f"A seed of {seed} cannot be used: give 0 or more.")
    if kind not in ("apartment", "office"):
        raise SceneError(f"There is no kind of building {kind!r}: give apartment or office.")
    for attempt in range(_MAX_ATTEMPTS):
        rng = np.random.default_rng([seed, rooms, ("apartment", "office").index(kind), attempt])
        building = _attempt(rooms, kind, rng)
        if building is not None:
            return building
    raise SceneError(f"No building of {rooms} rooms was found for seed {seed}: give another seed.")


def _attempt(num: int, kind: BuildingKind, rng: np.random.Generator) -> Building | None:
    """A building; None if two rooms that should be joined share too short a wall."""
    room_types = choose_room_types(num, kind, rng)
    clustered = num < 4 or (num <= 8 and rng.random() < (0.45 if kind == "apartment" else 0.25))
    cells = cluster(room_types, rng) if clustered else wings(num, kind, room_types, rng)
    if len(cells) != num or min(min(np.subtract(cell.high_m, cell.low_m)) for cell in cells) < 1.2:
        return None
    pairs = _adjacent(cells)
    joined = _tree(cells, pairs, rng)
    if joined is None:
        return None
    wanted = max(1, num // 6) if num >= 5 else int(num >= 3 and rng.random() < 0.5)
    extra = [pair for pair in sorted(pairs, key=lambda pair: pairs[pair][3]) if pair not in joined]
    loops = [pair for pair in extra if not any(cells[k].room_type in PRIVATE for k in pair)][:wanted]
    if num >= 5 and not loops:
        return None
    passages = tuple(_passage(cells, pair, pairs[pair], rng) for pair in sorted([*joined, *loops]))
    half = WALL_M / 2
    bounds = [(cell.low_m, cell.high_m) for cell in cells]
    floors = [shapely.box(x0 + half, y0 + half, x1 - half, y1 - half) for (x0, y0), (x1, y1) in bounds]
    return Building(named_rooms(floors, [cell.room_type for cell in cells]), passages, kind)


_Pair = tuple[int, int]
_Shared = tuple[int, float, tuple[float, float], float]
"""Axis that a shared wall runs along, its place on the other axis, the stretch both rooms share, reluctance."""


def _adjacent(cells: list[Cell]) -> dict[_Pair, _Shared]:
    pairs: dict[_Pair, _Shared] = {}
    for i, a in enumerate(cells):
        for j, b in enumerate(cells[:i]):
            for axis in (0, 1):
                across = 1 - axis
                low = max(a.low_m[axis], b.low_m[axis]) + WALL_M / 2
                high = min(a.high_m[axis], b.high_m[axis]) - WALL_M / 2
                if high - low < _DOOR_WIDTHS_M[0] + 2 * _DOOR_MARGIN_M:
                    continue
                for line, other in ((a.low_m[across], b.high_m[across]), (a.high_m[across], b.low_m[across])):
                    if abs(line - other) < 1e-6:
                        pairs[j, i] = (axis, line, (low, high), _reluctance(b, a))
    return pairs


def _reluctance(a: Cell, b: Cell) -> float:
    """How little a door between two rooms suggests itself."""
    room_types = {a.room_type, b.room_type}
    if room_types == {"corridor"}:
        return 0.0
    if "corridor" in room_types:
        return 1.0
    if room_types in ({"living", "kitchen"}, {"living", "dining"}, {"kitchen", "dining"}, {"reception", "lounge"}):
        return 2.0
    # Of doors alike, those between large rooms come first; the numbers never tie in practice.
    private = (a.room_type in PRIVATE) + (b.room_type in PRIVATE)
    return 10.0 * (1 + private) - 0.01 * (a.area_m2 + b.area_m2)


def _tree(cells: list[Cell], pairs: dict[_Pair, _Shared], rng: np.random.Generator) -> set[_Pair] | None:
    """Doors that just join all rooms (Kruskal); no way leads through a private room unless there is no other."""
    reluctance = {
        pair: shared[3] + (float(rng.uniform(0.0, 4.0)) if shared[3] > 2.0 else 0.0) for pair, shared in pairs.items()
    }
    group = list(range(len(cells)))
    joined: set[_Pair] = set()
    entered: set[int] = set()
    postponed = []

    def join(pair: _Pair) -> None:
        old, new = group[pair[1]], group[pair[0]]
        if old != new:
            joined.add(pair)
            entered.update(pair)
            group[:] = [new if own == old else own for own in group]

    for pair in sorted(pairs, key=lambda pair: reluctance[pair]):
        if any(cells[k].room_type in PRIVATE and k in entered for k in pair):
            postponed.append(pair)
        else:
            join(pair)
    for pair in postponed:
        join(pair)
    return joined if len(set(group)) == 1 else None


def _passage(cells: list[Cell], pair: _Pair, shared: _Shared, rng: np.random.Generator) -> Passage:
    """An opening in a shared wall: as wide as the corridor between corridors, wide between some rooms, else a door."""
    axis, line, (low, high), _ = shared
    a, b = cells[pair[0]], cells[pair[1]]
    room_types = {a.room_type, b.room_type}
    room = high - low - 2 * _DOOR_MARGIN_M
    width = float(rng.choice(_DOOR_WIDTHS_M))
    position = float(rng.uniform(0.0, 1.0))
    if room_types == {"corridor"}:
        room = width = high - low - 0.1
    elif room >= _WIDE_M[0] and (
        _reluctance(a, b) == 2.0
        or ("living" in room_types and not room_types & _CLOSED and rng.random() < 0.5)
        or room_types == {"reception", "corridor"}
    ):
        width = min(room, round(float(rng.uniform(*_WIDE_M)), 2))
    # Doors mostly lie near a corner, which leaves a long stretch of wall for furniture.
    position = position**2 if rng.random() < 0.5 else 1.0 - position**2
    if room_types == {"corridor"}:
        position = 0.5
    start = round((low + high - room) / 2 + position * (room - width), 3)
    first, last = (start, line - WALL_M / 2), (start + width, line + WALL_M / 2)
    if axis == 1:
        first, last = first[::-1], last[::-1]
    return Passage(pair, shapely.box(first[0], first[1], last[0], last[1]))
