"""Furnishes a building: windows, materials and furniture for every room; every door stays reachable."""

from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from anm_mj.scene.generation.building import Building, PlanRoom, RoomWall
from anm_mj.scene.generation.furniture_catalogue.home import curtains
from anm_mj.scene.generation.piece import Placed
from anm_mj.scene.generation.placement import RoomSpace
from anm_mj.scene.generation.room_style import RoomStyle, draw_style
from anm_mj.scene.generation.room_templates import pieces_for
from anm_mj.scene.generation.traversability import RoomGrid
from anm_mj.scene.generation.windows import given_windows, random_windows

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
    walls = tuple(
        replace(
            wall,
            windows=random_windows(wall, room.room_type, building.ceiling_m, rng)
            if building.windows is None
            else given_windows(wall, building.windows),
        )
        for wall in building.walls[index]
    )
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
            # Once one fits, no smaller one is tried.
            placed += islice(filter(None, map(space.put, alternatives)), 1)
    if room.room_type in _CURTAINED and rng.random() < 0.7:
        for wall in walls:
            for window in wall.windows:
                put = space.curtain(curtains(style, rng, window.end_m - window.start_m), wall, window)
                placed += filter(None, [put])
    return FurnishedRoom(room, walls, style, tuple(_traversable(grid, placed)), grid)


def _traversable(grid: RoomGrid, placed: list[Placed]) -> list[Placed]:
    """Remove pieces that block a path: one if that suffices, else the least important ones."""
    while placed and not grid.is_traversable(placed):
        without = [placed[:k] + placed[k + 1 :] for k in reversed(range(len(placed)))]
        placed = next((rest for rest in without if grid.is_traversable(rest)), placed[:-1])
    return placed
