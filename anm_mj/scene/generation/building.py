"""The unfurnished building: rooms, passages between them, and openings in their walls.

Generated layouts and imported floor plans both become a :class:`Building`; all later steps are the same.
"""

from collections import Counter
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from jaxtyping import Bool, Float64
from shapely.geometry.polygon import orient

from anm_mj.errors import SceneError
from anm_mj.scene.generation.wall import Wall, WallArea, between

_TOUCH_M = 2e-3
"""Walls that run along one another within this distance are the two sides of an opening."""
_OUTSIDE_M = (0.25, 0.5, 0.8)
"""There is a room behind a wall when one lies at any of these distances behind it."""


@dataclass(frozen=True, eq=False)
class PlanRoom:
    """A room's clear floor."""

    name: str
    """Unlike any other in the building."""
    room_type: str
    """What it is for, a key of ``ROOM_AREAS_M2``: "bedroom", "office", "corridor" ..."""
    floor: shapely.Polygon
    """World x, y [m]; may have holes."""


@dataclass(frozen=True, eq=False)
class Passage:
    """The floor of an opening through a wall: each of its ends lies on the edge of a room."""

    rooms: tuple[int, int]
    floor: shapely.Polygon

    @property
    def centre_m(self) -> tuple[float, float]:
        """World x, y of its middle."""
        return float(self.floor.centroid.x), float(self.floor.centroid.y)


@dataclass(frozen=True)
class GivenWindow:
    """A window of a floor plan, by the ends of its opening in the world."""

    start_m: tuple[float, float]
    end_m: tuple[float, float]
    z_low_m: float
    z_high_m: float


@dataclass(frozen=True, eq=False)
class RoomWall:
    """One straight wall of a room with what is open in it."""

    wall: Wall
    gaps: tuple[tuple[float, float, bool], ...]
    """Stretches (start, end, door) of the wall that are open: a door up to its lintel, otherwise up to the ceiling."""
    outer: bool
    """True if no other room lies behind it."""
    windows: tuple[WallArea, ...] = ()

    def solid(self, margin_m: float = 0.0) -> list[tuple[float, float]]:
        """Stretches of the wall between its gaps, each gap widened on both sides."""
        return between(((start - margin_m, end + margin_m) for start, end, _ in self.gaps), self.wall.length_m)


@dataclass(frozen=True, eq=False)
class Building:
    """Rooms and passages on one floor. Raises SceneError if there is no room, or two rooms have the same name."""

    rooms: tuple[PlanRoom, ...]
    passages: tuple[Passage, ...]
    kind: str = "apartment"
    """"apartment" or "office": what the furniture is like."""
    ceiling_m: float = 2.6
    door_height_m: float = 2.05
    windows: tuple[GivenWindow, ...] | None = None
    """The windows, or None to put some into the outer walls."""

    def __post_init__(self) -> None:
        if not self.rooms:
            raise SceneError("A building needs at least one room: the plan holds none.")
        if len({room.name for room in self.rooms}) < len(self.rooms):
            raise SceneError("Two rooms of the plan have the same name: give each its own.")

    @cached_property
    def walls(self) -> tuple[tuple[RoomWall, ...], ...]:
        """The walls of every room, with the gaps that passages and adjoining rooms make."""
        edges = _Edges([*(room.floor for room in self.rooms), *(passage.floor for passage in self.passages)])
        walls: list[list[RoomWall]] = [[] for _ in self.rooms]
        outer = edges.outer(np.array([room.floor for room in self.rooms], dtype=object))
        for k in np.flatnonzero(edges.owner < len(self.rooms)).tolist():
            gaps = tuple(edges.gaps(k, first_passage=len(self.rooms)))
            walls[edges.owner[k]].append(RoomWall(_wall(edges.left[k], edges.right[k]), gaps, bool(outer[k])))
        return tuple(tuple(of_room) for of_room in walls)

    def jambs(self, passage: Passage) -> list[Wall]:
        """The closed sides of a passage, as seen from inside it."""
        edges = _Edges([passage.floor, *(room.floor for room in self.rooms)])
        sides = []
        for k in np.flatnonzero(edges.owner == 0).tolist():
            left, right = edges.left[k], edges.right[k]
            length = float(np.linalg.norm(right - left))
            along = (right - left) / length
            closed = between(((a, b) for a, b, _ in edges.gaps(k, first_passage=len(edges.owner))), length)
            sides += [_wall(left + a * along, left + b * along) for a, b in closed if b - a > _TOUCH_M]
        return sides


def named_rooms(floors: list[shapely.Polygon], room_types: list[str]) -> tuple[PlanRoom, ...]:
    """Rooms with names of their own: the type, numbered where there are several."""
    total, seen = Counter(room_types), Counter[str]()
    rooms = []
    for floor, room_type in zip(floors, room_types, strict=True):
        seen[room_type] += 1
        name = room_type if total[room_type] == 1 else f"{room_type} {seen[room_type]}"
        rooms.append(PlanRoom(name, room_type, floor))
    return tuple(rooms)


def _wall(left: Float64[np.ndarray, "2"], right: Float64[np.ndarray, "2"]) -> Wall:
    return Wall((float(left[0]), float(left[1])), (float(right[0]), float(right[1])))


class _Edges:
    def __init__(self, polygons: list[shapely.Polygon]) -> None:
        left, right, owner = [], [], []
        for index, polygon in enumerate(polygons):
            # Clockwise about the outside, so that the inside lies to the right.
            turned = orient(polygon, sign=-1.0)
            for ring in (turned.exterior, *turned.interiors):
                points = np.asarray(ring.coords, dtype=np.float64)[:, :2]
                proper = np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-6
                left.append(points[:-1][proper])
                right.append(points[1:][proper])
                owner.append(np.full(int(proper.sum()), index))
        self.left, self.right = np.concatenate(left), np.concatenate(right)
        """Ends as seen from inside the polygon [m]."""
        self.owner = np.concatenate(owner)

    def gaps(self, k: int, first_passage: int) -> list[tuple[float, float, bool]]:
        """Stretches of an edge that run along edges of other polygons, in order and apart; True for passages."""
        p, q = self.left[k], self.right[k]
        length = float(np.linalg.norm(q - p))
        along = (q - p) / length
        normal = np.array([along[1], -along[0]])
        near = (np.abs((self.left - p) @ normal) < _TOUCH_M) & (np.abs((self.right - p) @ normal) < _TOUCH_M)
        near &= self.owner != self.owner[k]
        # An edge of another polygon that adjoins this one runs the other way.
        a, b = (self.right[near] - p) @ along, (self.left[near] - p) @ along
        found = [
            (max(float(start), 0.0), min(float(end), length), bool(other >= first_passage))
            for start, end, other in zip(a, b, self.owner[near], strict=True)
            if min(end, length) - max(start, 0.0) > _TOUCH_M
        ]
        gaps: list[tuple[float, float, bool]] = []
        for start, end, door in sorted(found):
            if gaps and start - gaps[-1][1] < _TOUCH_M and gaps[-1][2] == door:
                gaps[-1] = (gaps[-1][0], max(end, gaps[-1][1]), door)
            else:
                gaps.append((start, end, door))
        return gaps

    def outer(self, floors: np.ndarray) -> Bool[np.ndarray, " e"]:
        """True for edges with no other room behind them."""
        span = self.right - self.left
        along = span / np.linalg.norm(span, axis=1, keepdims=True)
        outward = np.stack([-along[:, 1], along[:, 0]], axis=1)
        tree = shapely.STRtree(floors)
        inner = np.zeros(len(span), dtype=bool)
        for distance_m in _OUTSIDE_M:
            for share in (0.1, 0.5, 0.9):
                points = shapely.points(self.left + share * span + distance_m * outward)
                hit, room = tree.query(points, predicate="within")
                inner[hit[room != self.owner[hit]]] = True
        return ~inner
