"""Floor plans of schema plan-1: rooms, doors as segments, walls and floor as polygons, all in metres."""

from typing import Any

import numpy as np
import shapely

from anm_mj.scene.generation.building import Building, named_rooms
from anm_mj.scene.importing.floorplans.cells import (
    CellPlan,
    cells_within,
    fill_nearest,
    grid_axes,
    take_passages,
    whole_rooms,
)
from anm_mj.scene.importing.floorplans.room_types import office_room_type

_CELL_M = 0.0625
"""Plans are drawn on this grid: walls follow it exactly [m]."""
_PASSAGE_M = 0.2
"""Length of passages [m]: walls are about as thick."""


def is_plan1(plan: Any) -> bool:
    """Whether a JSON document is a plan of this schema."""
    return isinstance(plan, dict) and plan.get("schema") == "plan-1"


def read_plan1(plan: Any) -> Building:
    """The building of a plan. Raises KeyError, TypeError or ValueError if the plan lacks or misstates something."""
    floors = [_polygon(room) for room in plan["rooms"]]
    origin, xs, ys = grid_axes(shapely.total_bounds(floors), _CELL_M)
    labels = np.full((len(ys), len(xs)), -1)
    for index, floor in enumerate(floors):
        labels[cells_within(floor, xs, ys)] = index
    walls = shapely.union_all([_polygon(wall) for wall in plan["walls"]])
    # Rooms were simplified one by one: what lies between two of them and in no wall belongs to the nearer.
    near, solid, core = (
        cells_within(region, xs, ys)
        for region in (shapely.union_all(floors).buffer(2 * _CELL_M), walls, walls.buffer(-0.4 * _CELL_M))
    )
    free = ((labels >= 0) | (near & ~solid)) & ~core
    cells = CellPlan(whole_rooms(fill_nearest(labels, free)), origin, _CELL_M)
    doors = np.array([[door["p0"], door["p1"]] for door in plan["doors"]], dtype=np.float64).reshape(-1, 2, 2)
    cells, passages = take_passages(cells, doors, _PASSAGE_M)
    outlines = cells.outlines()
    num_doors = np.bincount([room for passage in passages for room in passage.rooms], minlength=len(outlines))
    room_types = [office_room_type(floor, int(num_doors[k]), k) for k, floor in enumerate(outlines)]
    ceiling_m, door_m = float(plan.get("wall_height", 2.7)), float(plan.get("door_height", 2.1))
    # A lintel stays above a door, as its frame has a head.
    door_m = min(door_m, ceiling_m - 0.1)
    return Building(named_rooms(outlines, room_types), tuple(passages), "office", ceiling_m, door_m)


def _polygon(entry: dict[str, Any]) -> shapely.Polygon:
    polygon = shapely.Polygon(entry["exterior"], entry.get("holes", []))
    repaired = polygon if polygon.is_valid else shapely.make_valid(polygon)
    parts = [part for part in shapely.get_parts(repaired) if isinstance(part, shapely.Polygon)]
    if not parts:
        raise ValueError("an outline encloses nothing")
    return max(parts, key=lambda part: part.area)
