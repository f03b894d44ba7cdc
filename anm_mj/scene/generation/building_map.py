"""Top-down maps of generated buildings in milliseconds, for tests and for training on thousands of them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int16

from anm_mj.scene.generation.furnish import furnish
from anm_mj.scene.generation.layout import BuildingKind, plan_building
from anm_mj.scene.generation.traversability import CELL_M

_MARGIN_CELLS = 4
"""Wall about the outer rooms."""


@dataclass(frozen=True, eq=False)
class BuildingMap:
    """A building seen from above at body heights (0.05 to 1.35 m); ``[row, col]``, row along y and col along x."""

    obstacles: Bool[np.ndarray, "rows cols"]
    """True for walls, furniture and whatever lies outside."""
    rooms: Int16[np.ndarray, "rows cols"]
    """Index of the room; -1 for walls, passages and the outside, but not for furniture."""
    room_types: tuple[str, ...]
    origin_xy_m: Float64[np.ndarray, "2"]
    """World x, y of the outer corner of cell [0, 0] [m]."""
    resolution_m: float


def generated_map(rooms: int, seed: int, kind: BuildingKind = "apartment", furniture: bool = True) -> BuildingMap:
    """The map of the building that ``generate_scene`` makes of the same arguments, at 5 cm; with or without furniture.
    Raises SceneError if an argument is out of its range.
    """
    building = plan_building(rooms, seed, kind)
    furnished = furnish(building, seed, furniture=furniture)
    low = np.min([room.grid.low_cell for room in furnished], axis=0) - _MARGIN_CELLS
    ends = [np.add(room.grid.low_cell, room.grid.floor.shape[::-1]) for room in furnished]
    cols, rows = np.max(ends, axis=0) + _MARGIN_CELLS - low
    obstacles = np.ones((rows, cols), dtype=bool)
    labels = np.full((rows, cols), -1, dtype=np.int16)
    for passage in building.passages:
        # Passages are short and straight; their bounds say enough at this resolution.
        x0, y0, x1, y1 = np.asarray(passage.floor.bounds) / CELL_M - np.tile(low, 2)
        obstacles[round(y0) : round(y1), round(x0) : round(x1)] = False
    for index, room in enumerate(furnished):
        col, row = room.grid.low_cell - low
        part = (slice(row, row + room.grid.floor.shape[0]), slice(col, col + room.grid.floor.shape[1]))
        labels[part][room.grid.floor] = index
        obstacles[part][room.grid.floor] = room.grid.solid(list(room.placed))[room.grid.floor]
    return BuildingMap(obstacles, labels, tuple(room.room.room_type for room in furnished), low * CELL_M, CELL_M)
