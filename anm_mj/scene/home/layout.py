"""Rooms, the walls between them, and the doors and windows in the walls.

A room is a rectangle of clear floor. Its walls are drawn from inside only, so the gap between two rooms is a wall whose
two faces belong to them, and nothing is drawn that cannot be seen: no outside faces, no roof, no underside. Doorways
cross such a gap with jambs, lintel and threshold; windows are niches that end in a pane.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from anm_mj.scene.generation.furniture.quads import Material, Quads, join, rectangle
from anm_mj.scene.generation.furniture.wall import Hole, Wall, around_holes, casing, niche, skirting

WALL_M = 0.12
"""Thickness of the walls between rooms."""
CEILING_M = 2.6
DOOR_WIDTH_M = 0.9
DOOR_HEIGHT_M = 2.05

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
        wall.upright(*rectangle_, room.finish.wall)
        for rectangle_ in around_holes(wall.length_m, doors + window_holes, CEILING_M)
    ]
    pieces += skirting(wall, doors, room.finish.trim)
    for door in doors:
        pieces += casing(wall, door, room.finish.trim)
    for window, hole in zip(windows, window_holes, strict=True):
        pieces += niche(wall, hole, window.pane, room.finish.trim)
    return pieces


def _wall_of(room: Room, side: Side) -> Wall:
    (x0, y0), (x1, y1) = room.low_m, room.high_m
    corners = {"north": ((x0, y1), (x1, y1)), "east": ((x1, y1), (x1, y0))}
    corners |= {"south": ((x1, y0), (x0, y0)), "west": ((x0, y0), (x0, y1))}
    return Wall(*corners[side])


def _opens_into(room: Room, side: Side, doorway: Doorway) -> bool:
    (x0, y0), (x1, y1) = room.low_m, room.high_m
    face = {"south": y0 - WALL_M / 2, "north": y1 + WALL_M / 2, "west": x0 - WALL_M / 2, "east": x1 + WALL_M / 2}[side]
    runs_along = "x" if side in ("south", "north") else "y"
    low, high = (x0, x1) if runs_along == "x" else (y0, y1)
    return doorway.along == runs_along and abs(doorway.line_m - face) < 1e-6 and low < doorway.centre_m < high


def _door_hole(wall: Wall, doorway: Doorway) -> Hole:
    middle = _along(wall, doorway.centre_m, doorway.along)
    return Hole(middle - doorway.width_m / 2, middle + doorway.width_m / 2, 0.0, DOOR_HEIGHT_M)


def _window_hole(wall: Wall, window: Window) -> Hole:
    middle = _along(wall, window.centre_m, "x" if window.side in ("south", "north") else "y")
    return Hole(middle - window.width_m / 2, middle + window.width_m / 2, window.z_low_m, window.z_high_m)


def _along(wall: Wall, world_m: float, axis: Literal["x", "y"]) -> float:
    return abs(world_m - wall.left_m["xy".index(axis)])
