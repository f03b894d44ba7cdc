"""Houses of ProcTHOR (Deitke et al., "ProcTHOR", NeurIPS 2022): rooms, doors and windows of their JSON.

Unity's axes are left-handed with y up, so (x, z) seen from above is (x, y) here. The furniture refers to assets that
are not part of the file; the rooms are furnished by the generator instead.
"""

from typing import Any

import numpy as np
import shapely
from jaxtyping import Float64

from anm_mj.scene.generation.building import Building, GivenWindow, Passage, named_rooms
from anm_mj.scene.generation.layout import WALL_M
from anm_mj.scene.importing.floorplans.room_types import room_type_of_word

_OVERLAP_M2 = 0.1
"""So much may the floors of two rooms have in common [m2]."""
_BEYOND_M = 1.0
"""So far beyond the end of its wall may a hole reach [m]."""
_ALONG_M = 0.01
"""A wall this near to a room's outline is one of its walls [m]."""


def is_procthor(plan: Any) -> bool:
    """Whether a JSON document is a house of ProcTHOR."""
    return (
        isinstance(plan, dict)
        and {"rooms", "walls", "doors"} <= plan.keys()
        and "floorPolygon" in str(plan["rooms"])[:5000]
    )


def read_procthor(plan: Any) -> Building:
    """The building of a house. Raises KeyError, TypeError or ValueError if the house lacks or misstates something."""
    rooms = plan["rooms"]
    index = {room["id"]: k for k, room in enumerate(rooms)}
    # The walls have no thickness in the file; half of ours is taken from either room.
    outlines = [shapely.Polygon([(point["x"], point["z"]) for point in room["floorPolygon"]]) for room in rooms]
    walls = {wall["id"]: np.array([[p["x"], p["y"], p["z"]] for p in wall["polygon"]], float) for wall in plan["walls"]}
    # Where two rooms are one space, the file has walls that are marked as empty.
    empty = shapely.MultiLineString([walls[wall["id"]][:2, [0, 2]] for wall in plan["walls"] if wall.get("empty")])
    floors = [_floor(outline, empty) for outline in outlines]
    for a, b in shapely.STRtree(floors).query(floors, predicate="intersects").T:
        if a < b and floors[a].intersection(floors[b]).area > _OVERLAP_M2:
            raise ValueError(f"its rooms {rooms[a]['id']!r} and {rooms[b]['id']!r} lie over one another")
    if not walls:
        raise ValueError("it has no walls")
    passages, door_height_m = [], 2.05
    for door in plan["doors"]:
        a, b = index.get(door["room0"]), index.get(door["room1"])
        if a is None or b is None or a == b:
            continue
        p, q, _, top = _opening(door, walls)
        along = (q - p) / np.linalg.norm(q - p)
        across = WALL_M / 2 * np.array([-along[1], along[0]])
        passages.append(Passage((a, b), shapely.Polygon([p - across, q - across, q + across, p + across])))
        door_height_m = max(door_height_m, min(top, 2.2))
    windows = []
    for window in plan.get("windows", []):
        p, q, low, top = _opening(window, walls)
        windows.append(GivenWindow((float(p[0]), float(p[1])), (float(q[0]), float(q[1])), low, top))
    ceiling_m = max(float(wall[:, 1].max()) for wall in walls.values())
    room_types = [room_type_of_word(str(room.get("roomType", ""))) or "living" for room in rooms]
    return Building(
        named_rooms(floors, room_types),
        tuple(passages),
        "apartment",
        ceiling_m,
        min(door_height_m, ceiling_m - 0.1),
        tuple(windows),
    )


def _floor(outline: shapely.Polygon, empty: shapely.MultiLineString) -> shapely.Polygon:
    """The floor between the walls about a room; where these are ``empty``, it reaches up to the outline. Raises
    ValueError if that is no floor.
    """
    floor = outline.buffer(-WALL_M / 2, join_style="mitre")
    # Of an outline that crosses itself, the buffer keeps a part.
    if outline.is_valid:
        solid = outline.boundary.difference(empty.buffer(_ALONG_M, cap_style="flat"))
        # An empty wall of other rooms may end at this one.
        if solid.length < outline.length - 10 * _ALONG_M:
            walls = solid.buffer(WALL_M / 2, cap_style="square", join_style="mitre")
            floor = outline.difference(walls).simplify(0.0)
        if isinstance(floor, shapely.Polygon) and floor.area > 0.5:
            return floor
    raise ValueError("a room's floorPolygon is too small or crosses itself")


def _opening(
    entry: Any, walls: dict[str, Float64[np.ndarray, "k 3"]]
) -> tuple[Float64[np.ndarray, "2"], Float64[np.ndarray, "2"], float, float]:
    """Ends of an opening in the world [m], and its lower and upper edge."""
    corners = walls[entry["wall0"]]
    # The first two corners of a wall are its ends at the floor; holes are measured from the first.
    start, end = corners[0, [0, 2]], corners[1, [0, 2]]
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length
    if "holePolygon" in entry:
        low, high = entry["holePolygon"][0], entry["holePolygon"][1]
    else:
        # Houses of version 0, as the generator itself writes them.
        low, high = entry["boundingBox"]["min"], entry["boundingBox"]["max"]
    reach = {"x": length, "y": float(corners[:, 1].max())}
    if not all(-_BEYOND_M <= corner[axis] <= end + _BEYOND_M for corner in (low, high) for axis, end in reach.items()):
        raise ValueError(f"the hole {entry.get('id', '')!r} lies outside of its wall of {length:.4g} m")
    return start + low["x"] * along, start + high["x"] * along, float(low["y"]), float(high["y"])
