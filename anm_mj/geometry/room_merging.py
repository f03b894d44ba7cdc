"""Room segmentation by merging: parts of the free floor become rooms, with doors between them.

A door is a minimum of the clearance that is clearly narrower than the floor on both sides (critical points: Thrun,
Artificial Intelligence 99(1), 1998). Each part merges with the neighbour behind its widest exit, until every part is
clearly wider than its widest exit. This equals the watershed of the clearance with shallow basins filled in, widest
bottlenecks first (Bormann et al., "Room segmentation: survey, implementation, and analysis", ICRA 2016): the widest
exit of a part comes before its other exits, so that all parts can merge at once. Then parts too small for a room merge
with the neighbour behind their widest exit, again widest first. A few rounds do, each a pass over the exits.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from anm_mj.geometry.connected_components import connected_components


def merge_into_rooms(
    exits: Int[np.ndarray, "e 2"],
    width_m: Float[np.ndarray, " e"],
    may_be_door: Bool[np.ndarray, " e"],
    clearance_m: Float[np.ndarray, " n"],
    floor_m2: Float[np.ndarray, " n"],
    narrowing: float,
    min_room_m2: float,
) -> Int[np.ndarray, " n"]:
    """The room of each part when no two rooms can merge any more, numbered from 0 in no particular order.

    Args:
        exits: the two parts that each exit connects.
        width_m: half the width of each exit at its widest place, the clearance there [m].
        may_be_door: exits that may separate rooms; any other connects two parts of one room.
        clearance_m: largest clearance of each part [m].
        floor_m2: floor of each part [m2].
        narrowing: a door is at most this share of the largest clearance on either side.
        min_room_m2: smaller rooms are niches of their neighbour [m2].
    """
    room = connected_components(exits[~may_be_door], len(clearance_m))
    # Doors of one size are equally wide: the first of them counts as the widest.
    by_width = np.argsort(-width_m, kind="stable")
    rank = np.empty(len(width_m), np.int64)
    rank[by_width] = np.arange(len(width_m))
    while True:
        num = int(room.max(initial=-1)) + 1
        sides = room[exits]
        between = sides[:, 0] != sides[:, 1]
        widest_m, first = np.zeros(num), np.full(num, len(width_m))
        np.maximum.at(widest_m, room, clearance_m)
        np.minimum.at(first, sides[between].ravel(), np.repeat(rank[between], 2))
        with_exit = np.flatnonzero(first < len(width_m))
        chosen = by_width[first[with_exit]]
        merges = width_m[chosen] > narrowing * widest_m[with_exit]
        if not merges.any():
            # No room becomes too shallow again: rooms only get wider, and their exits narrower.
            small = np.bincount(room, floor_m2, num) < min_room_m2
            behind = sides[chosen].sum(axis=1) - with_exit
            # A small neighbour merges through its own wider exit first: together they may be large enough to stay.
            merges = small[with_exit] & (~small[behind] | (first[behind] == first[with_exit]))
        if not merges.any():
            return room
        room = connected_components(sides[chosen[merges]], num)[room]
