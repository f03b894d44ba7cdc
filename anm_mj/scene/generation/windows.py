"""Windows in the outer walls of rooms."""

import numpy as np

from anm_mj.scene.generation.building import GivenWindow, RoomWall
from anm_mj.scene.generation.wall import WallArea

_SHARE_M = 2.7
_BESIDE_M = 0.2
"""A given window belongs to walls that run along it within this distance [m]."""
_HIGH = ("bathroom", "washroom")
"""Rooms that nobody should look into."""
_DARK = ("storage", "archive")


def given_windows(wall: RoomWall, windows: tuple[GivenWindow, ...]) -> tuple[WallArea, ...]:
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


def random_windows(wall: RoomWall, room_type: str, ceiling_m: float, rng: np.random.Generator) -> tuple[WallArea, ...]:
    """Windows where there is nothing behind a wall."""
    if not wall.outer or (room_type in _DARK and rng.random() < 0.6):
        return ()
    high = room_type in _HIGH
    z_low, z_high = (1.45, 2.0) if high else (0.9, min(2.1, ceiling_m - 0.35))
    windows = []
    for start, end in wall.solid(0.2):
        num = 1 if high else int((end - start) // _SHARE_M) or int(end - start > 1.5)
        share = (end - start) / max(num, 1)
        if share < 1.45:
            continue
        width = round(float(rng.uniform(0.6, 0.8) if high else rng.uniform(0.9, min(1.8, share - 0.5))), 2)
        shift = float(rng.uniform(-1.0, 1.0)) * min(0.4, (share - width) / 2 - 0.12)
        for k in range(num):
            middle = start + (k + 0.5) * share + shift
            windows.append(WallArea(middle - width / 2, middle + width / 2, z_low, z_high))
    return tuple(windows)
