"""Generates scenes from a seed or from a building: furnishes, lights, checks and writes them."""

from __future__ import annotations

import json
import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely
from jaxtyping import Float64

from anm_mj.errors import SceneError
from anm_mj.scene.folder import Scene
from anm_mj.scene.generation.atlas import paint, points_on
from anm_mj.scene.generation.building import Building
from anm_mj.scene.generation.furnish import FurnishedRoom, furnish
from anm_mj.scene.generation.lamps import lamps, lights
from anm_mj.scene.generation.layout import BuildingKind, plan_building
from anm_mj.scene.generation.move_furniture import Move, move_furniture
from anm_mj.scene.generation.quads import Quads, join
from anm_mj.scene.generation.shell import Surface, add_passage, add_room_shell
from anm_mj.scene.generation.voxel_light import VOXEL_M, VoxelLighting
from anm_mj.scene.navigable import DEFAULT_FOOTPRINT, NavigableArea, choose_starts, navigable_area
from anm_mj.scene.writer import SceneInfo, check_destination, write_scene
from anm_mj.utils.files import write_text

_logger = logging.getLogger(__name__)

_LIGHT_SPACING_M = 0.14
_COARSER = 1.6
"""Texels are this much larger than the materials ask for: a scene of forty rooms stays of a size to keep."""
_SHADES = 64
_MIN_REACHED_M2 = 0.1
"""A room counts as reached when the robot's axis gets to this much of its floor [m2]."""
_STEPS_PER_ROOM, _BASE_STEPS = 100, 300
MOVED = "moved.json"
"""File of a scene folder that says which furniture stands somewhere else."""


def generate_scene(
    out: Path,
    rooms: int,
    seed: int,
    kind: BuildingKind = "apartment",
    name: str | None = None,
    *,
    overwrite: bool = True,
    moved: int = 0,
) -> Scene:
    """Make a furnished building and write it as a scene folder; the same bytes for the same arguments.

    Args:
        out: The scene folder to make; one already there is replaced.
        rooms: Number of rooms, corridors counted; 1 to 60.
        seed: Which of the buildings of this size; 0 or more.
        kind: "apartment" or "office".
        name: Name of the scene; that of the folder by default.
        overwrite: False to refuse a folder that holds a scene already.
        moved: So many pieces of furniture stand somewhere else than in the scene of the same rooms, seed and kind;
            ``moved.json`` in the folder says which, from where and to where.

    Raises:
        SceneError: if an argument is out of its range or the folder cannot be written.
    """
    check_destination(out, overwrite)
    if moved < 0:
        raise SceneError(f"--moved is {moved}; give a number of pieces from 0 up.")
    source = f"anm-mj scene generate --rooms {rooms} --seed {seed} --kind {kind}{f' --moved {moved}' * (moved > 0)}"
    info = SceneInfo(name or out.resolve().name, source, "MIT", rooms=rooms)
    return write_building(plan_building(rooms, seed, kind), seed, info, out, moved=moved)


def write_building(
    building: Building, seed: int, info: SceneInfo, out: Path, furniture: bool = True, moved: int = 0
) -> Scene:
    """Furnish a building, make sure that the robot reaches every room, light it and write it.

    Args:
        building: Rooms and passages.
        seed: Decides on all furniture and materials; 0 or more.
        info: Name, origin and licence; rooms and budget are filled in.
        out: The scene folder to make.
        furniture: False for empty rooms.
        moved: Number of pieces that stand somewhere else than without this.

    Raises:
        SceneError: if so many pieces cannot be moved, the robot fits nowhere or the folder cannot be written.
    """
    furnished, surfaces, area = _reachable(building, seed, furniture)
    moves: list[Move] = []
    if moved:
        reached = _reached(area, building)

        def is_passable(rooms: list[FurnishedRoom]) -> bool:
            return _reached(_area(_surfaces(building, rooms, seed)), building) >= reached

        furnished, moves = move_furniture(furnished, moved, seed, is_passable)
        surfaces = _surfaces(building, furnished, seed)
        area = _area(surfaces)
    lighting = _lighting(building, furnished)
    submeshes = [
        paint(room.room.name, _coarsened(surface.quads()), lighting, _LIGHT_SPACING_M, surface.cuts, _SHADES)
        for room, surface in zip(furnished, surfaces, strict=True)
    ]
    num = len(building.rooms)
    info = replace(info, rooms=num, budget_steps=_BASE_STEPS + _STEPS_PER_ROOM * num, cull_face=True)
    scene = write_scene(submeshes, info, out, choose_starts(area, DEFAULT_FOOTPRINT))
    if moves:
        write_text(out / MOVED, json.dumps({"moved": [move.entry for move in moves]}, indent=1) + "\n")
    return scene


def _reachable(
    building: Building, seed: int, furniture: bool
) -> tuple[list[FurnishedRoom], list[Surface], NavigableArea]:
    """The furnished rooms, those emptied that the robot would not get into otherwise, and where it may stand."""
    furnished, surfaces, area = _attempt(building, seed, frozenset(), furniture)
    everywhere = set(range(len(building.rooms)))
    if not furniture or _reached(area, building) == everywhere:
        return furnished, surfaces, area
    # A plan may hold rooms that the robot does not fit into even when they are empty.
    reachable = _reached(_attempt(building, seed, frozenset(), False)[2], building)
    bare: frozenset[int] = frozenset()
    while missing := reachable - _reached(area, building):
        beside = {k for passage in building.passages if missing & set(passage.rooms) for k in passage.rooms}
        closed = missing | beside
        if closed <= bare:
            closed = everywhere
        bare |= closed
        _logger.info("emptied to let the robot through: %s", ", ".join(building.rooms[k].name for k in sorted(closed)))
        furnished, surfaces, area = _attempt(building, seed, bare, furniture)
    return furnished, surfaces, area


def _attempt(
    building: Building, seed: int, bare: frozenset[int], furniture: bool
) -> tuple[list[FurnishedRoom], list[Surface], NavigableArea]:
    """Furnished rooms, their surfaces, and where the robot may stand among them."""
    furnished = furnish(building, seed, bare, furniture)
    surfaces = _surfaces(building, furnished, seed)
    return furnished, surfaces, _area(surfaces)


def _surfaces(building: Building, furnished: list[FurnishedRoom], seed: int) -> list[Surface]:
    """The surfaces of all rooms."""
    return [_surface(building, furnished, index, seed) for index in range(len(furnished))]


def _area(surfaces: list[Surface]) -> NavigableArea:
    """Where the robot may stand among surfaces."""
    triangles = np.concatenate([_triangles(surface.quads().corners_m) for surface in surfaces])
    return navigable_area(triangles, DEFAULT_FOOTPRINT)


def _reached(area: NavigableArea, building: Building) -> set[int]:
    """Rooms that the largest component gets into."""
    places = shapely.points(area.places(1))
    tree = shapely.STRtree(np.array([room.floor for room in building.rooms], dtype=object))
    _, room = tree.query(places, predicate="within")
    counts = np.bincount(room, minlength=len(building.rooms)) * area.grid.resolution_m**2
    return {int(k) for k in np.flatnonzero(counts >= _MIN_REACHED_M2)}


def _surface(building: Building, furnished: list[FurnishedRoom], index: int, seed: int) -> Surface:
    """All surfaces of one room; a passage belongs to the first of its rooms."""
    room, surface = furnished[index], Surface()
    add_room_shell(surface, building, room, 1000 * seed + 100 * index)
    for passage in building.passages:
        if passage.rooms[0] == index:
            add_passage(surface, building, passage, room.style.floor, room.style.trim)
    for lamp in lamps(building, room):
        surface.add(lamp)
    for piece in room.placed:
        surface.add(piece.quads())
    return surface


def _triangles(corners_m: Float64[np.ndarray, "n 4 3"]) -> Float64[np.ndarray, "f 3 3"]:
    """Two triangles for every quad; cut ones whole, which adds nothing but floor and ceiling inside of walls."""
    return np.concatenate([corners_m[:, [0, 1, 2]], corners_m[:, [0, 2, 3]]])


def _lighting(building: Building, furnished: list[FurnishedRoom]) -> VoxelLighting:
    """The light of all lamps and windows among all furniture."""
    x0, y0, x1, y1 = shapely.total_bounds([room.room.floor for room in furnished])
    origin = np.array([x0 - 0.3, y0 - 0.3, -0.16])
    cols, rows, layers = np.ceil((np.array([x1 + 0.3, y1 + 0.3, building.ceiling_m + 0.16]) - origin) / VOXEL_M).astype(
        int
    )
    xs, ys = (start + (np.arange(num) + 0.5) * VOXEL_M for start, num in ((origin[0], cols), (origin[1], rows)))
    zs = origin[2] + (np.arange(layers) + 0.5) * VOXEL_M
    open_voxels = np.zeros((layers, rows, cols), dtype=bool)
    for floor, top_m in [
        *((room.room.floor, building.ceiling_m) for room in furnished),
        *((passage.floor, building.door_height_m) for passage in building.passages),
    ]:
        left, low, right, high = floor.bounds
        i = slice(*np.searchsorted(ys, (low, high)))
        j = slice(*np.searchsorted(xs, (left, right)))
        shapely.prepare(floor)
        inside = shapely.contains_xy(floor, *np.meshgrid(xs[j], ys[i]))
        open_voxels[:, i, j] |= inside[None] & ((zs > 0.0) & (zs < top_m))[:, None, None]
    pieces = [piece.quads() for room in furnished for piece in room.placed if piece.piece.placement != "rug"]
    points = points_on(join(*pieces), 0.6 * VOXEL_M) if pieces else np.zeros((0, 3))
    sources = [light for room in furnished for light in lights(building, room)]
    return VoxelLighting(origin, open_voxels, points, sources)


def _coarsened(surface: Quads) -> Quads:
    """The same surface with larger texels."""
    larger = {material: replace(material, texel_m=material.texel_m * _COARSER) for material in set(surface.materials)}
    return Quads(surface.corners_m, surface.uv_m, tuple(larger[material] for material in surface.materials))
