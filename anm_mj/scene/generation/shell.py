"""Floors, ceilings, walls, windows, door frames and lamps of rooms of any outline, and what shines in them."""

from collections.abc import Iterable, Iterator
from itertools import pairwise

import mapbox_earcut
import numpy as np
import shapely
from jaxtyping import Float64
from shapely.geometry.polygon import orient

from anm_mj.scene.generation.atlas import Cut
from anm_mj.scene.generation.building import Building, Passage, RoomWall
from anm_mj.scene.generation.furnish import FurnishedRoom
from anm_mj.scene.generation.quads import Material, Parts, Quads, box, join, lathe, rectangle
from anm_mj.scene.generation.room_style import CEILING
from anm_mj.scene.generation.textures import glow, rgb, view_outside
from anm_mj.scene.generation.voxel_light import Light
from anm_mj.scene.generation.wall import Wall, WallArea, between

_WINDOW_DEPTH_M = 0.14
_SKIRTING_HEIGHT_M, _SKIRTING_DEPTH_M = 0.08, 0.012
_CASING_WIDTH_M, _CASING_DEPTH_M = 0.07, 0.015
_LAMP_SPACING_M = 4.0
_TILE_M = 3.0
"""Floors that are no rectangle are painted in tiles, so that little is painted in vain [m]."""

Patch = tuple[Quads, Cut | None]
"""Quads, or one quad of which only the triangles of a cut are there."""


class Surface:
    """The quads of patches, in order."""

    def __init__(self, patches: Iterable[Patch]) -> None:
        pieces: list[Quads] = []
        self.cuts: dict[int, Cut] = {}
        """By the index of the quad."""
        num = 0
        for piece, cut in patches:
            if cut is not None:
                self.cuts[num] = cut
            pieces.append(piece)
            num += len(piece.corners_m)
        self.quads = join(*pieces)


def room_shell(building: Building, furnished: FurnishedRoom, seed: int) -> Iterator[Patch]:
    """All that a room has when it is empty."""
    style, ceiling_m = furnished.style, building.ceiling_m
    yield from _level(furnished.room.floor, 0.0, style.floor, up=True)
    yield from _level(furnished.room.floor, ceiling_m, CEILING, up=False)
    for index, wall in enumerate(furnished.walls):
        for piece in _wall(wall, building, style.wall, style.trim, seed + 10 * index):
            yield piece, None


def passage_shell(building: Building, passage: Passage, floor: Material, trim: Material) -> Iterator[Patch]:
    """Threshold, lintel and sides of an opening."""
    yield from _level(passage.floor, 0.0, floor, up=True)
    yield from _level(passage.floor, building.door_height_m, trim, up=False)
    for jamb in building.jambs(passage):
        yield jamb.upright(WallArea(0.0, jamb.length_m, 0.0, building.door_height_m), trim), None


def _level(outline: shapely.Polygon, z_m: float, material: Material, up: bool) -> Iterator[Patch]:
    """A level surface that is seen from above (a floor) or below (a ceiling)."""
    for tile in _tiles(outline):
        x0, y0, x1, y1 = tile.bounds
        along_x, along_y = (x1 - x0, 0.0, 0.0), (0.0, y1 - y0, 0.0)
        first, second = (along_x, along_y) if up else (along_y, along_x)
        # Surface coordinates are world coordinates, so that the pattern runs on from tile to tile.
        piece = rectangle((x0, y0, z_m), first, second, material, (x0, y0) if up else (y0, x0))
        if tile.area > 0.9999 * (x1 - x0) * (y1 - y0):
            yield piece, None
            continue
        triangles = (_triangulated(tile) - (x0, y0)) / (x1 - x0, y1 - y0)
        # Seen from below, s runs along y, which turns the triangles round: they are turned back.
        yield piece, triangles if up else triangles[:, ::-1, ::-1]


def _tiles(outline: shapely.Polygon) -> list[shapely.Polygon]:
    """The outline if it is an upright rectangle, else its parts on a grid."""
    if outline.area > 0.9999 * shapely.box(*outline.bounds).area:
        return [outline]
    x0, y0, x1, y1 = outline.bounds
    xs = np.linspace(x0, x1, max(1, round((x1 - x0) / _TILE_M)) + 1)
    ys = np.linspace(y0, y1, max(1, round((y1 - y0) / _TILE_M)) + 1)
    parts = [
        part
        for left, right in pairwise(xs)
        for low, high in pairwise(ys)
        for part in shapely.get_parts(shapely.intersection(outline, shapely.box(left, low, right, high)))
    ]
    return [part for part in parts if isinstance(part, shapely.Polygon) and part.area > 1e-6]


def _triangulated(polygon: shapely.Polygon) -> Float64[np.ndarray, "k 3 2"]:
    turned = orient(polygon)
    rings = [np.asarray(ring.coords)[:-1, :2] for ring in (turned.exterior, *turned.interiors)]
    points = np.concatenate(rings)
    ends = np.cumsum([len(ring) for ring in rings]).astype(np.uint32)
    triangles = points[mapbox_earcut.triangulate_float64(points, ends).reshape(-1, 3)]
    a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    clockwise = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] < 0.0
    triangles[clockwise] = triangles[clockwise][:, ::-1]
    return triangles


def _wall(room_wall: RoomWall, building: Building, material: Material, trim: Material, seed: int) -> Iterator[Quads]:
    wall, ceiling_m = room_wall.wall, building.ceiling_m
    doors = [WallArea(a, b, 0.0, building.door_height_m) for a, b, door in room_wall.gaps if door]
    wide = [WallArea(a, b, 0.0, ceiling_m) for a, b, door in room_wall.gaps if not door]
    for area in _around_holes(wall.length_m, [*doors, *wide, *room_wall.windows], ceiling_m):
        yield wall.upright(area, material)
    last_m = wall.length_m - _CASING_WIDTH_M
    framed = [door for door in doors if door.start_m >= _CASING_WIDTH_M and door.end_m <= last_m]
    for door in framed:
        yield from _casing(wall, door, trim)
    gaps = [
        (hole.start_m - _CASING_WIDTH_M * (hole in framed), hole.end_m + _CASING_WIDTH_M * (hole in framed))
        for hole in sorted([*doors, *wide], key=lambda hole: hole.start_m)
    ]
    for start, end in between(gaps, wall.length_m):
        yield wall.block(WallArea(start, end, 0.0, _SKIRTING_HEIGHT_M), _SKIRTING_DEPTH_M, trim, "-z +y")
    for k, hole in enumerate(room_wall.windows):
        pane = view_outside(seed + k, hole.end_m - hole.start_m, hole.z_high_m - hole.z_low_m)
        yield from _niche(wall, hole, pane, trim)


def _around_holes(length_m: float, holes: list[WallArea], ceiling_m: float) -> list[WallArea]:
    """The rectangles that make up a wall above its skirting, without its holes."""
    areas, start = [], 0.0
    for hole in sorted(holes, key=lambda hole: hole.start_m):
        areas.append(WallArea(start, hole.start_m, _SKIRTING_HEIGHT_M, ceiling_m))
        areas.append(WallArea(hole.start_m, hole.end_m, hole.z_high_m, ceiling_m))
        if hole.z_low_m > 0.0:
            areas.append(WallArea(hole.start_m, hole.end_m, _SKIRTING_HEIGHT_M, hole.z_low_m))
        start = hole.end_m
    areas.append(WallArea(start, length_m, _SKIRTING_HEIGHT_M, ceiling_m))
    return [area for area in areas if area.end_m - area.start_m > 1e-6 and area.z_high_m - area.z_low_m > 1e-6]


def _casing(wall: Wall, door: WallArea, trim: Material) -> Parts:
    """The frame about a door opening: two posts and a head."""
    left, right, top = door.start_m - _CASING_WIDTH_M, door.end_m + _CASING_WIDTH_M, door.z_high_m
    yield wall.block(WallArea(left, door.start_m, 0.0, top), _CASING_DEPTH_M, trim, "-z +y +z")
    yield wall.block(WallArea(door.end_m, right, 0.0, top), _CASING_DEPTH_M, trim, "-z +y +z")
    yield wall.block(WallArea(left, right, top, top + _CASING_WIDTH_M), _CASING_DEPTH_M, trim, "+y")


def _niche(wall: Wall, hole: WallArea, pane: Material, trim: Material) -> Parts:
    """A window: pane, reveals, sill, and the bars that divide it, 3 cm before the pane."""
    depth, bar = _WINDOW_DEPTH_M, 0.04
    start, end, low, high = hole.start_m, hole.end_m, hole.z_low_m, hole.z_high_m
    up = (0.0, 0.0, high - low)
    left, right = wall.point(start, -depth, low), wall.point(end, -depth, low)
    yield rectangle(left, np.subtract(right, left), up, pane)
    foot = wall.point(0.0, 0.0, 0.0)
    inward, across = (np.subtract(wall.point(*place, 0.0), foot) for place in ((0.0, depth), (end - start, 0.0)))
    outward = inward * (-1.0, -1.0, 1.0)
    yield rectangle(wall.point(start, 0.0, low), across, outward, trim)
    yield rectangle(wall.point(start, 0.0, high), outward, across, trim)
    yield rectangle(wall.point(start, 0.0, low), outward, up, trim)
    yield rectangle(right, inward, up, trim)
    yield wall.block(WallArea(start - 0.05, end + 0.05, low - 0.03, low), 0.06, trim, "+y")
    behind = Wall(wall.point(0.0, -depth, 0.0)[:2], wall.point(wall.length_m, -depth, 0.0)[:2])
    middle = (start + end) / 2
    for x0, x1 in ((middle - bar / 2, middle + bar / 2), (start, start + bar), (end - bar, end)):
        yield behind.block(WallArea(x0, x1, low, high), 0.03, trim, "+y -z +z")


def _lamp_places(floor: shapely.Polygon) -> list[tuple[float, float]]:
    """Where a room's lamps hang: evenly spread, at least one."""
    x0, y0, x1, y1 = floor.bounds
    cols, rows = max(1, round((x1 - x0) / _LAMP_SPACING_M)), max(1, round((y1 - y0) / _LAMP_SPACING_M))
    xs = x0 + (np.arange(cols) + 0.5) * (x1 - x0) / cols
    ys = y0 + (np.arange(rows) + 0.5) * (y1 - y0) / rows
    inner = floor.buffer(-0.3)
    places = [(float(x), float(y)) for y in ys for x in xs if inner.contains(shapely.Point(x, y))]
    point = floor.representative_point()
    return places or [(float(point.x), float(point.y))]


def lamps(building: Building, furnished: FurnishedRoom) -> list[Quads]:
    """The lamps themselves: round in homes, long panels in offices."""
    top = building.ceiling_m
    if building.kind == "apartment":
        drum = [(0.0, top - 0.12), (0.19, top - 0.12), (0.22, top - 0.03), (0.22, top)]
        lamp = lathe(drum, glow(rgb("fff4d6")), 16)
    else:
        lamp = box((-0.6, -0.15, top - 0.05), (0.6, 0.15, top), glow(rgb("fbfdff")), "+z")
    return [lamp.placed(x, y) for x, y in _lamp_places(furnished.room.floor)]


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
