"""Which rooms there are, how they are finished, and where doors and windows are."""

from __future__ import annotations

from anm_mj.scene.generation.furniture.textures import (
    dots,
    leaves,
    plain,
    planks,
    plaster,
    rgb,
    spots,
    stripes,
    tiles,
    view_outside,
)
from anm_mj.scene.home.layout import Doorway, Finish, Room, Side, Window

_WHITE = plain(rgb("f4f1ea"), 0.01)
_CEILING = plaster(rgb("f3f1ec"), 0.02, texel_m=0.04)


def home_rooms() -> list[Room]:
    """Seven rooms on 11 m by 8.6 m: four along the north side, two large ones along the south side, a hall between."""
    return [
        Room(
            "living room",
            (0.0, 0.0),
            (5.84, 4.14),
            Finish(planks(rgb("b5855a")), plaster(rgb("ecd9ad")), _CEILING, _WHITE),
            (_window("south", 2.0, 1.7, 1), _window("south", 4.5, 1.3, 2), _window("west", 0.86, 0.9, 3)),
        ),
        Room(
            "kitchen",
            (5.96, 0.0),
            (11.0, 4.14),
            Finish(tiles(rgb("e9e4da"), rgb("b9694c"), 0.3, rgb("8f8a80")), plaster(rgb("a9cfc9")), _CEILING, _WHITE),
            (_window("south", 9.6, 1.2, 4, 1.12), _window("east", 2.9, 1.3, 5)),
        ),
        Room(
            "hall",
            (3.96, 4.26),
            (11.0, 5.44),
            Finish(planks(rgb("7b5137"), 0.1, 0.9), stripes(rgb("e7d3bf"), rgb("c98f7e"), 0.18), _CEILING, _WHITE),
        ),
        Room(
            "bedroom",
            (0.0, 4.26),
            (3.84, 8.6),
            Finish(planks(rgb("d8b98c"), 0.18, 1.6, 0.2), leaves(rgb("c3cbe0"), rgb("8d9cc4")), _CEILING, _WHITE),
            (_window("north", 2.2, 1.6, 6), _window("west", 7.8, 0.8, 7)),
        ),
        Room(
            "bathroom",
            (3.96, 5.56),
            (5.94, 8.6),
            Finish(
                tiles(rgb("6f7f8c"), rgb("7b8b98"), 0.2, rgb("4d5963")),
                tiles(rgb("dff0f5"), rgb("cfe6f0"), 0.15, rgb("ffffff"), 0.04),
                _CEILING,
                _WHITE,
            ),
            (_window("north", 4.95, 0.8, 8, 1.45),),
        ),
        Room(
            "study",
            (6.06, 5.56),
            (8.34, 8.6),
            Finish(planks(rgb("9c5f3c"), 0.09, 0.6, 0.4), plaster(rgb("7fa088")), _CEILING, _WHITE),
            (_window("north", 7.2, 1.3, 9),),
        ),
        Room(
            "child's room",
            (8.46, 5.56),
            (11.0, 8.6),
            Finish(
                spots(rgb("7fa7c9"), rgb("88b0d1"), 0.5, 60.0), dots(rgb("fbe9a9"), rgb("ef8e5b")), _CEILING, _WHITE
            ),
            (_window("north", 9.41, 1.1, 10),),
        ),
    ]


def home_doorways() -> list[Doorway]:
    """Openings of the house; living room, kitchen and hall make a loop."""
    return [
        Doorway("y", 5.9, 1.45),
        Doorway("x", 4.2, 4.75, 1.4),
        Doorway("x", 4.2, 8.0),
        Doorway("y", 3.9, 4.85),
        Doorway("x", 5.5, 4.75),
        Doorway("x", 5.5, 7.0),
        Doorway("x", 5.5, 9.3),
    ]


def small_rooms() -> list[Room]:
    """Two rooms of 3 m by 3 m."""
    return [
        Room(
            "west room",
            (0.0, 0.0),
            (2.94, 3.0),
            Finish(planks(rgb("b5855a")), plaster(rgb("ecd9ad")), _CEILING, _WHITE),
            (_window("south", 1.5, 1.2, 1),),
        ),
        Room(
            "east room",
            (3.06, 0.0),
            (6.0, 3.0),
            Finish(
                tiles(rgb("e9e4da"), rgb("6f8fa8"), 0.3, rgb("8f8a80")),
                stripes(rgb("dfe8d8"), rgb("9dbb96")),
                _CEILING,
                _WHITE,
            ),
            (_window("north", 4.5, 1.2, 2),),
        ),
    ]


def small_doorways() -> list[Doorway]:
    """The one door of the small scene."""
    return [Doorway("y", 3.0, 1.5)]


def _window(side: Side, centre_m: float, width_m: float, seed: int, z_low_m: float = 0.9) -> Window:
    return Window(side, centre_m, width_m, view_outside(seed, width_m, 2.1 - z_low_m), z_low_m)
