"""Furnishes a building: windows, materials and furniture for every room; every door stays reachable."""

from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from anm_mj.scene.generation.building import Building, GivenWindow, PlanRoom, RoomWall
from anm_mj.scene.generation.furniture_catalogue.home import curtains
from anm_mj.scene.generation.piece import Piece, Placed, drawn
from anm_mj.scene.generation.placement import RoomSpace
from anm_mj.scene.generation.room_style import RoomStyle, draw_style
from anm_mj.scene.generation.room_templates import pieces_for
from anm_mj.scene.generation.traversability import RoomGrid
from anm_mj.scene.generation.wall import WallArea

_WINDOW_SHARE_M = 2.7
_LEAST_WINDOW_M = 0.2
"""Rooms too low for a window of this height have none [m]."""
_TALLEST_M = 2.4
"""No piece is higher [m]."""
_BESIDE_M = 0.2
"""A given window belongs to walls that run along it within this distance [m]."""
_HIGH = ("bathroom", "washroom")
"""Rooms that nobody should look into."""
_DARK = ("storage", "archive")
_CURTAINED = ("living", "bedroom", "child", "dining", "library", "lounge")


@dataclass(frozen=True, eq=False)
class FurnishedRoom:
    """A room with all that is in it."""

    room: PlanRoom
    walls: tuple[RoomWall, ...]
    style: RoomStyle
    placed: tuple[Placed, ...]
    grid: RoomGrid


def furnish(
    building: Building, seed: int, bare: frozenset[int] = frozenset(), furniture: bool = True
) -> list[FurnishedRoom]:
    """Furnish all rooms but the ``bare`` ones (none at all without ``furniture``).

    The same for the same arguments, each room regardless of the others; ``seed`` is 0 or more.
    """
    indices = range(len(building.rooms))
    return [_furnish_room(building, index, seed, furniture and index not in bare) for index in indices]


def _furnish_room(building: Building, index: int, seed: int, furniture: bool) -> FurnishedRoom:
    room = building.rooms[index]
    # Materials have a generator of their own, so that an emptied room looks the same.
    style = draw_style(room.room_type, np.random.default_rng([seed, index, 1]))
    rng = np.random.default_rng([seed, index, 2])
    if building.windows is None:
        windows = [_random_windows(wall, room.room_type, building.ceiling_m, rng) for wall in building.walls[index]]
    else:
        windows = [_given_windows(wall, building.windows) for wall in building.walls[index]]
    walls = tuple(replace(wall, windows=own) for wall, own in zip(building.walls[index], windows, strict=True))
    grid = RoomGrid(room.floor, walls)
    if not furniture:
        return FurnishedRoom(room, walls, style, (), grid)
    space = RoomSpace(room.floor, walls, rng)
    room_type = "office corridor" if room.room_type == "corridor" and building.kind == "office" else room.room_type
    area_m2 = float(room.floor.area)
    placed: list[Placed] = []
    # Large rooms get the furniture of several.
    for _ in range(max(1, min(4, round(area_m2 / 45.0)))):
        for alternatives in pieces_for(room_type, area_m2, style, rng):
            low_enough = (piece for piece in alternatives if _is_below(piece, building.ceiling_m))
            # Once one fits, no smaller one is tried.
            placed += islice(filter(None, map(space.put, low_enough)), 1)
    if room.room_type in _CURTAINED and rng.random() < 0.7:
        for wall in walls:
            for window in wall.windows:
                piece = drawn(curtains(style, rng, window.end_m - window.start_m))
                put = space.curtain(piece, wall, window) if _is_below(piece, building.ceiling_m) else None
                placed += filter(None, [put])
    return FurnishedRoom(room, walls, style, tuple(_traversable(grid, placed)), grid)


def _is_below(piece: Piece, ceiling_m: float) -> bool:
    """Whether all of a piece, what stands on it included, is below a ceiling."""
    return ceiling_m >= _TALLEST_M or float(piece.quads.corners_m[:, :, 2].max()) <= ceiling_m


def _given_windows(wall: RoomWall, windows: tuple[GivenWindow, ...]) -> tuple[WallArea, ...]:
    """Those of the plan's windows that lie in a wall and lead outside."""
    along = np.array(wall.wall.along)
    across = np.array([-along[1], along[0]])
    found: list[WallArea] = []
    for window in windows if wall.outer else ():
        ends = np.array([window.start_m, window.end_m]) - wall.wall.left_m
        low, high = sorted(float(value) for value in ends @ along)
        fits = any(a + 0.02 < low and high < b - 0.02 for a, b in wall.solid(0.1))
        apart = all(high < other.start_m or low > other.end_m for other in found)
        if np.abs(ends @ across).max() < _BESIDE_M and high - low > 0.3 and fits and apart:
            found.append(WallArea(low, high, window.z_low_m, window.z_high_m))
    return tuple(found)


def _random_windows(wall: RoomWall, room_type: str, ceiling_m: float, rng: np.random.Generator) -> tuple[WallArea, ...]:
    """Windows where there is nothing behind a wall."""
    if not wall.outer or (room_type in _DARK and rng.random() < 0.6):
        return ()
    high = room_type in _HIGH
    z_low, z_high = (1.45, min(2.0, ceiling_m - 0.1)) if high else (0.9, min(2.1, ceiling_m - 0.35))
    if z_high - z_low < _LEAST_WINDOW_M:
        return ()
    windows = []
    for start, end in wall.solid(0.2):
        num = 1 if high else int((end - start) // _WINDOW_SHARE_M) or int(end - start > 1.5)
        share = (end - start) / max(num, 1)
        if share < 1.45:
            continue
        width = round(float(rng.uniform(0.6, 0.8) if high else rng.uniform(0.9, min(1.8, share - 0.5))), 2)
        shift = float(rng.uniform(-1.0, 1.0)) * min(0.4, (share - width) / 2 - 0.12)
        for k in range(num):
            middle = start + (k + 0.5) * share + shift
            windows.append(WallArea(middle - width / 2, middle + width / 2, z_low, z_high))
    return tuple(windows)


def _traversable(grid: RoomGrid, placed: list[Placed]) -> list[Placed]:
    """Remove pieces that block a path: one if that suffices, else the least important ones."""
    while placed and not grid.is_traversable(placed):
        without = [placed[:k] + placed[k + 1 :] for k in reversed(range(len(placed)))]
        placed = next((rest for rest in without if grid.is_traversable(rest)), placed[:-1])
    return placed
