"""Ceiling lamps, and the light sources of lamps and windows."""

import numpy as np
import shapely

from anm_mj.scene.generation.building import Building
from anm_mj.scene.generation.furnish import FurnishedRoom
from anm_mj.scene.generation.furniture.decor import ceiling_lamp
from anm_mj.scene.generation.quads import Quads, box
from anm_mj.scene.generation.textures import glow, rgb
from anm_mj.scene.generation.voxel_light import Light

_SPACING_M = 4.0


def _lamp_places(floor: shapely.Polygon) -> list[tuple[float, float]]:
    """Where a room's lamps hang: evenly spread, at least one."""
    x0, y0, x1, y1 = floor.bounds
    cols, rows = max(1, round((x1 - x0) / _SPACING_M)), max(1, round((y1 - y0) / _SPACING_M))
    xs = x0 + (np.arange(cols) + 0.5) * (x1 - x0) / cols
    ys = y0 + (np.arange(rows) + 0.5) * (y1 - y0) / rows
    inner = floor.buffer(-0.3)
    places = [(float(x), float(y)) for y in ys for x in xs if inner.contains(shapely.Point(x, y))]
    point = floor.representative_point()
    return places or [(float(point.x), float(point.y))]


def lamps(building: Building, furnished: FurnishedRoom) -> list[Quads]:
    """The lamps themselves: round in homes, long panels in offices."""
    places = _lamp_places(furnished.room.floor)
    if building.kind == "apartment":
        return [ceiling_lamp(building.ceiling_m, rgb("fff4d6")).placed(x, y) for x, y in places]
    low, high = (-0.6, -0.15, building.ceiling_m - 0.05), (0.6, 0.15, building.ceiling_m)
    return [box(low, high, glow(rgb("fbfdff")), "+z").placed(x, y) for x, y in places]


def lights(building: Building, furnished: FurnishedRoom) -> list[Light]:
    """Light sources of lamps and windows; lamps are brighter the more floor they light."""
    places = _lamp_places(furnished.room.floor)
    share_m2 = min(float(furnished.room.floor.area) / len(places), 20.0)
    z = building.ceiling_m - 0.14
    found = [Light((x, y, z), (0.0, 0.0, -1.0), 0.35 + 0.07 * share_m2) for x, y in places]
    for wall in furnished.walls:
        for window in wall.windows:
            width, height = window.end_m - window.start_m, window.z_high_m - window.z_low_m
            centre = wall.wall.point((window.start_m + window.end_m) / 2, 0.02, (window.z_low_m + window.z_high_m) / 2)
            x, y = wall.wall.along
            found.append(Light(centre, (y, -x, 0.0), 0.9 * width * height))
    return found
