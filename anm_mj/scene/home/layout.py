"""Rooms, the walls between them, and the doors and windows in the walls.

A room is a rectangle of clear floor. Its walls are drawn from inside only, so the gap between two rooms is a wall whose
two faces belong to them, and nothing is drawn that cannot be seen: no outside faces, no roof, no underside. Doorways
cross such a gap with jambs, lintel and threshold; windows are niches that end in a pane.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from anm_mj.scene.home.quads import Material, Quads, box, join, rectangle

WALL_M = 0.12
"""Thickness of the walls between rooms."""
CEILING_M = 2.6
DOOR_WIDTH_M = 0.9
DOOR_HEIGHT_M = 2.05
WINDOW_DEPTH_M = 0.14
SKIRTING_HEIGHT_M = 0.08
SKIRTING_DEPTH_M = 0.012
CASING_WIDTH_M = 0.07
CASING_DEPTH_M = 0.015

Side = Literal["south", "north", "west", "east"]


@dataclass(frozen=True)
class Finish:
    """What a room's surfaces are made of."""

    floor: Material
    wall: Material
    ceiling: Material
    trim: Material


@dataclass(frozen=True)
class Window:
    """A niche in an outer wall with a pane at its end."""

    side: Side
    centre_m: float
    """World x (south, north) or y (west, east) of its middle."""
    width_m: float
    pane: Material
    z_low_m: float = 0.9
    z_high_m: float = 2.1


@dataclass(frozen=True)
class Room:
    """A rectangle of clear floor with its walls."""

    name: str
    low_m: tuple[float, float]
    """Smallest x, y of the clear floor."""
    high_m: tuple[float, float]
    finish: Finish
    windows: tuple[Window, ...] = ()

    @property
    def centre_m(self) -> tuple[float, float]:
        """World x, y of the middle of the floor."""
        return (self.low_m[0] + self.high_m[0]) / 2, (self.low_m[1] + self.high_m[1]) / 2


@dataclass(frozen=True)
class Doorway:
    """An opening in the wall between two rooms."""

    along: Literal["x", "y"]
    """The axis that the wall runs along."""
    line_m: float
    """The other coordinate of the wall's middle."""
    centre_m: float
    """World coordinate of the opening's middle along the wall."""
    width_m: float = DOOR_WIDTH_M


@dataclass(frozen=True)
class _Hole:
    """A rectangle left out of a wall, in the wall's own coordinates: along it, and z."""

    start_m: float
    end_m: float
    z_low_m: float
    z_high_m: float


@dataclass(frozen=True)
class _Wall:
    """A room's wall as seen from inside: it begins at the left end and runs to the right."""

    left_m: tuple[float, float]
    right_m: tuple[float, float]

    @property
    def length_m(self) -> float:
        return float(np.hypot(self.right_m[0] - self.left_m[0], self.right_m[1] - self.left_m[1]))

    def upright(
        self, start_m: float, end_m: float, z_low_m: float, z_high_m: float, material: Material, depth_m: float = 0.0
    ) -> Quads:
        """A rectangle on the wall, ``depth_m`` behind its face."""
        corner = self.point(start_m, -depth_m, z_low_m)
        along, _ = self._axes()
        span = end_m - start_m
        return rectangle(
            corner,
            (along[0] * span, along[1] * span, 0.0),
            (0.0, 0.0, z_high_m - z_low_m),
            material,
            (start_m, z_low_m),
        )

    def block(
        self,
        start_m: float,
        end_m: float,
        z_low_m: float,
        z_high_m: float,
        front_m: float,
        material: Material,
        skip: str,
    ) -> Quads:
        """A box on the wall's face; in ``skip``, x runs along the wall, +y is its back, against the wall."""
        piece = box((start_m, -front_m, z_low_m), (end_m, 0.0, z_high_m), material, skip)
        along, _ = self._axes()
        yaw = float(np.degrees(np.arctan2(along[1], along[0])))
        return piece.placed(self.left_m[0], self.left_m[1], yaw)

    def point(self, along_m: float, inward_m: float, z_m: float) -> tuple[float, float, float]:
        """World coordinates of a place given along the wall, inward from it, and by height."""
        along, inward = self._axes()
        return (
            self.left_m[0] + along[0] * along_m + inward[0] * inward_m,
            self.left_m[1] + along[1] * along_m + inward[1] * inward_m,
            z_m,
        )

    def _axes(self) -> tuple[tuple[float, float], tuple[float, float]]:
        x = (self.right_m[0] - self.left_m[0]) / self.length_m
        y = (self.right_m[1] - self.left_m[1]) / self.length_m
        return (x, y), (y, -x)


def room_shell(room: Room, doorways: list[Doorway]) -> Quads:
    """Floor, ceiling, walls, skirting, door casings and windows of one room."""
    (x0, y0), (x1, y1) = room.low_m, room.high_m
    pieces = [
        rectangle((x0, y0, 0.0), (x1 - x0, 0.0, 0.0), (0.0, y1 - y0, 0.0), room.finish.floor),
        rectangle((x0, y0, CEILING_M), (0.0, y1 - y0, 0.0), (x1 - x0, 0.0, 0.0), room.finish.ceiling),
    ]
    for side in ("south", "north", "west", "east"):
        pieces += _wall_pieces(room, side, doorways)
    return join(*pieces)


def doorway_passage(doorway: Doorway, finish: Finish) -> Quads:
    """Threshold, jambs and lintel where an opening crosses its wall."""
    half, depth = doorway.width_m / 2, WALL_M
    # Drawn for a wall along x about the origin; a wall along y is the same turned by a right angle.
    passage = join(
        rectangle((-half, -depth / 2, 0.0), (2 * half, 0.0, 0.0), (0.0, depth, 0.0), finish.floor),
        rectangle((-half, -depth / 2, 0.0), (0.0, depth, 0.0), (0.0, 0.0, DOOR_HEIGHT_M), finish.trim),
        rectangle((half, depth / 2, 0.0), (0.0, -depth, 0.0), (0.0, 0.0, DOOR_HEIGHT_M), finish.trim),
        rectangle((-half, -depth / 2, DOOR_HEIGHT_M), (0.0, depth, 0.0), (2 * half, 0.0, 0.0), finish.trim),
    )
    if doorway.along == "x":
        return passage.placed(doorway.centre_m, doorway.line_m)
    return passage.placed(doorway.line_m, doorway.centre_m, 90.0)


def _wall_pieces(room: Room, side: Side, doorways: list[Doorway]) -> list[Quads]:
    """One wall of a room with everything that belongs to it."""
    wall = _wall_of(room, side)
    windows = [window for window in room.windows if window.side == side]
    doors = [_door_hole(wall, doorway) for doorway in doorways if _opens_into(room, side, doorway)]
    window_holes = [_window_hole(wall, window) for window in windows]

    pieces = [
        wall.upright(*rectangle_, room.finish.wall) for rectangle_ in _around_holes(wall.length_m, doors + window_holes)
    ]
    pieces += _skirting(wall, doors, room.finish.trim)
    for door in doors:
        pieces += _casing(wall, door, room.finish.trim)
    for window, hole in zip(windows, window_holes, strict=True):
        pieces += _niche(wall, hole, window.pane, room.finish.trim)
    return pieces


def _wall_of(room: Room, side: Side) -> _Wall:
    (x0, y0), (x1, y1) = room.low_m, room.high_m
    corners = {"north": ((x0, y1), (x1, y1)), "east": ((x1, y1), (x1, y0))}
    corners |= {"south": ((x1, y0), (x0, y0)), "west": ((x0, y0), (x0, y1))}
    return _Wall(*corners[side])


def _opens_into(room: Room, side: Side, doorway: Doorway) -> bool:
    (x0, y0), (x1, y1) = room.low_m, room.high_m
    face = {"south": y0 - WALL_M / 2, "north": y1 + WALL_M / 2, "west": x0 - WALL_M / 2, "east": x1 + WALL_M / 2}[side]
    runs_along = "x" if side in ("south", "north") else "y"
    low, high = (x0, x1) if runs_along == "x" else (y0, y1)
    return doorway.along == runs_along and abs(doorway.line_m - face) < 1e-6 and low < doorway.centre_m < high


def _door_hole(wall: _Wall, doorway: Doorway) -> _Hole:
    middle = _along(wall, doorway.centre_m, doorway.along)
    return _Hole(middle - doorway.width_m / 2, middle + doorway.width_m / 2, 0.0, DOOR_HEIGHT_M)


def _window_hole(wall: _Wall, window: Window) -> _Hole:
    middle = _along(wall, window.centre_m, "x" if window.side in ("south", "north") else "y")
    return _Hole(middle - window.width_m / 2, middle + window.width_m / 2, window.z_low_m, window.z_high_m)


def _along(wall: _Wall, world_m: float, axis: Literal["x", "y"]) -> float:
    return abs(world_m - wall.left_m["xy".index(axis)])


def _around_holes(length_m: float, holes: list[_Hole]) -> list[tuple[float, float, float, float]]:
    """Rectangles (start, end, z_low, z_high) that make up a wall above its skirting, without its holes.

    The wall's foot is hidden by the skirting and left out.
    """
    rectangles = []
    start = 0.0
    for hole in sorted(holes, key=lambda hole: hole.start_m):
        rectangles.append((start, hole.start_m, SKIRTING_HEIGHT_M, CEILING_M))
        rectangles.append((hole.start_m, hole.end_m, hole.z_high_m, CEILING_M))
        if hole.z_low_m > 0.0:
            rectangles.append((hole.start_m, hole.end_m, SKIRTING_HEIGHT_M, hole.z_low_m))
        start = hole.end_m
    return [*rectangles, (start, length_m, SKIRTING_HEIGHT_M, CEILING_M)]


def _skirting(wall: _Wall, doors: list[_Hole], trim: Material) -> list[Quads]:
    """Boards along the wall's foot, up to the casings of its doors."""
    ends = [0.0]
    for door in sorted(doors, key=lambda door: door.start_m):
        ends += [door.start_m - CASING_WIDTH_M, door.end_m + CASING_WIDTH_M]
    ends.append(wall.length_m)
    return [
        wall.block(start, end, 0.0, SKIRTING_HEIGHT_M, SKIRTING_DEPTH_M, trim, "-z +y -x +x")
        for start, end in zip(ends[::2], ends[1::2], strict=True)
        if end > start
    ]


def _casing(wall: _Wall, door: _Hole, trim: Material) -> list[Quads]:
    """The frame about a door opening: two posts and a head."""
    top = door.z_high_m
    return [
        wall.block(door.start_m - CASING_WIDTH_M, door.start_m, 0.0, top, CASING_DEPTH_M, trim, "-z +y +z"),
        wall.block(door.end_m, door.end_m + CASING_WIDTH_M, 0.0, top, CASING_DEPTH_M, trim, "-z +y +z"),
        wall.block(
            door.start_m - CASING_WIDTH_M,
            door.end_m + CASING_WIDTH_M,
            top,
            top + CASING_WIDTH_M,
            CASING_DEPTH_M,
            trim,
            "+y",
        ),
    ]


def _niche(wall: _Wall, hole: _Hole, pane: Material, trim: Material) -> list[Quads]:
    """A window: reveals, sill, pane, and the bars that divide it."""
    depth, bar = WINDOW_DEPTH_M, 0.04
    start, end, low, high = hole.start_m, hole.end_m, hole.z_low_m, hole.z_high_m
    width, height = end - start, high - low
    glass = rectangle(
        wall.point(start, -depth, low),
        _difference(wall.point(end, -depth, low), wall.point(start, -depth, low)),
        (0.0, 0.0, height),
        pane,
    )
    inward = _difference(wall.point(0.0, depth, 0.0), wall.point(0.0, 0.0, 0.0))
    outward = (-inward[0], -inward[1], 0.0)
    across = _difference(wall.point(width, 0.0, 0.0), wall.point(0.0, 0.0, 0.0))
    bars = [((start + end) / 2 - bar / 2, (start + end) / 2 + bar / 2, low, high)]
    bars += [(start, start + bar, low, high), (end - bar, end, low, high)]
    return [
        glass,
        rectangle(wall.point(start, 0.0, low), across, outward, trim),
        rectangle(wall.point(start, 0.0, high), outward, across, trim),
        rectangle(wall.point(start, 0.0, low), outward, (0.0, 0.0, height), trim),
        rectangle(wall.point(end, -depth, low), inward, (0.0, 0.0, height), trim),
        wall.block(start - 0.05, end + 0.05, low - 0.03, low, 0.06, trim, "+y"),
        *(_bar(wall, extent, depth, trim) for extent in bars),
    ]


def _bar(wall: _Wall, extent_m: tuple[float, float, float, float], depth_m: float, trim: Material) -> Quads:
    """A window bar that stands 3 cm before the pane."""
    behind = _Wall(wall.point(0.0, -depth_m, 0.0)[:2], wall.point(wall.length_m, -depth_m, 0.0)[:2])
    start, end, low, high = extent_m
    return behind.block(start, end, low, high, 0.03, trim, "+y -z +z")


def _difference(a: tuple[float, float, float], b: tuple[float, float, float]) -> tuple[float, float, float]:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]
