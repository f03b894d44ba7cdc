"""Moves furniture in a furnished building: the same rooms on another day, for maps that are to notice it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from anm_mj.errors import SceneError
from anm_mj.scene.generation.furnish import FurnishedRoom
from anm_mj.scene.generation.piece import Placed, box_corners
from anm_mj.scene.generation.placement import RoomSpace

_STANDING = ("wall", "corner", "middle")
_MIN_HEIGHT_M, _MIN_AREA_M2 = 0.35, 0.15
"""Smaller pieces stay where they are."""
_HUNG_ABOVE_M = 1.0
"""Higher pieces stay where they are in rooms with something on the walls."""


@dataclass(frozen=True, eq=False)
class Move:
    """A piece of furniture that stands somewhere else than before."""

    room: str
    before: Placed
    after: Placed

    @property
    def entry(self) -> dict[str, Any]:
        """The move as an entry of ``moved.json``."""
        return {
            "name": self.before.piece.name,
            "room": self.room,
            "height_m": self.before.piece.height_m,
            "from": _place(self.before),
            "to": _place(self.after),
        }


def move_furniture(
    furnished: list[FurnishedRoom], count: int, seed: int, is_passable: Callable[[list[FurnishedRoom]], bool]
) -> tuple[list[FurnishedRoom], list[Move]]:
    """Put ``count`` pieces, chosen by ``seed``, to other places in their rooms, none where any piece stood before.

    ``is_passable`` says whether the robot still gets everywhere among the furniture. Raises SceneError if fewer pieces
    can be moved.
    """
    rng = np.random.default_rng([seed, 3])
    movable = [
        (index, number)
        for index, room in enumerate(furnished)
        for number, placed in enumerate(room.placed)
        if _is_movable(placed, room)
    ]
    moves: list[Move] = []
    order = [movable[k] for k in rng.permutation(len(movable))]
    first = {index: (index, number) for index, number in reversed(order)}.values()
    # One piece of each room before the second of any.
    for index, number in sorted(order, key=lambda place: place not in first):
        if len(moves) == count:
            break
        room = furnished[index]
        before = room.placed[number]
        # Where a piece moved away, no other one goes: both changes can be told apart.
        gone = [move.before for move in moves if move.room == room.room.name]
        space = RoomSpace(room.room.floor, room.walls, np.random.default_rng([seed, 3, index, number]))
        for other in (*room.placed, *gone):
            if other.piece.placement in (*_STANDING, "window"):
                space.occupy(other)
        after = space.put(before.piece)
        if after is None:
            continue
        placed = (*room.placed[:number], after, *room.placed[number + 1 :])
        changed = [*furnished[:index], replace(room, placed=placed), *furnished[index + 1 :]]
        if room.grid.is_traversable(list(placed)) and is_passable(changed):
            furnished = changed
            moves.append(Move(room.room.name, before, after))
    if len(moves) < count:
        raise SceneError(f"--moved is {count}, but only {len(moves)} pieces of this building can be moved.")
    return furnished, moves


def _is_movable(placed: Placed, room: FurnishedRoom) -> bool:
    piece = placed.piece
    x0, y0, x1, y1 = piece.outline_m
    hung = any(other.piece.placement == "hang" for other in room.placed)
    large = piece.height_m >= _MIN_HEIGHT_M and (x1 - x0) * (y1 - y0) >= _MIN_AREA_M2
    return piece.placement in _STANDING and large and not (hung and piece.height_m > _HUNG_ABOVE_M)


def _place(placed: Placed) -> dict[str, Any]:
    corners = box_corners(placed.piece.outline_m, placed.x_m, placed.y_m, placed.yaw_deg)
    return {
        "x_m": round(placed.x_m, 4),
        "y_m": round(placed.y_m, 4),
        "yaw_deg": round(placed.yaw_deg, 3),
        "outline_xy_m": corners.round(4).tolist(),
    }
