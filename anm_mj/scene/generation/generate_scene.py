"""Generates scenes from a seed or from a building: furnishes, lights, checks and writes them."""

import json
import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import shapely

from anm_mj.errors import SceneError
from anm_mj.scene.folder import Scene
from anm_mj.scene.generation.atlas import paint, points_on
from anm_mj.scene.generation.building import Building
from anm_mj.scene.generation.furnish import FurnishedRoom, furnish
from anm_mj.scene.generation.layout import BuildingKind, plan_building
from anm_mj.scene.generation.move_furniture import Move, move_furniture
from anm_mj.scene.generation.quads import join
from anm_mj.scene.generation.shell import Patch, Surface, lamps, lights, passage_shell, room_shell
from anm_mj.scene.generation.voxel_light import VOXEL_M, VoxelLighting
from anm_mj.scene.navigable import NavigableArea, choose_starts, navigable_area
from anm_mj.scene.writer import SceneInfo, check_destination, write_scene
from anm_mj.types import DEFAULT_FOOTPRINT
from anm_mj.utils.files import write_text

_logger = logging.getLogger(__name__)

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
    """Make a furnished building and write it as a scene folder; the same bytes for the same arguments. Raises
    SceneError if an argument is out of its range or the folder cannot be written.

    Args:
        out: The scene folder to make; one already there is replaced.
        rooms: Number of rooms, corridors counted; 1 to 60.
        seed: Which of the buildings of this size; 0 or more.
        kind: "apartment" or "office".
        name: Name of the scene; that of the folder by default.
        overwrite: False to refuse a folder that holds a scene already.
        moved: Number of pieces of furniture that stand elsewhere than in the scene of the same rooms, seed and kind;
            ``moved.json`` in the folder says which, from where and to where.
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

    ``seed``, 0 or more, decides on all furniture and materials; ``furniture`` false leaves the rooms empty; ``moved``
    pieces stand elsewhere than without this. Rooms and budget of ``info`` are filled in. Raises SceneError if fewer
    pieces can be moved, the robot fits nowhere or the folder cannot be written.
    """
    interior = _reachable(building, seed, furniture)
    moves: list[Move] = []
    if moved:
        reached = interior.reached
        furnished, moves = move_furniture(
            interior.furnished, moved, seed, lambda rooms: _Interior(building, rooms, seed).reached >= reached
        )
        interior = _Interior(building, furnished, seed)
    lighting = _lighting(building, interior.furnished)
    submeshes = [
        paint(room.room.name, surface.quads, lighting, surface.cuts)
        for room, surface in zip(interior.furnished, interior.surfaces, strict=True)
    ]
    num = len(building.rooms)
    info = replace(info, rooms=num, budget_steps=_BASE_STEPS + _STEPS_PER_ROOM * num, cull_face=True)
    scene = write_scene(submeshes, info, out, choose_starts(interior.area, DEFAULT_FOOTPRINT))
    if moves:
        write_text(out / MOVED, json.dumps({"moved": [move.entry for move in moves]}, indent=1) + "\n")
    return scene


@dataclass(frozen=True, eq=False)
class _Interior:
    building: Building
    furnished: list[FurnishedRoom]
    seed: int

    @cached_property
    def surfaces(self) -> list[Surface]:
        """All surfaces of each room."""
        return [Surface(self._patches(index)) for index in range(len(self.furnished))]

    def _patches(self, index: int) -> Iterator[Patch]:
        """Those of one room; a passage belongs to the first of its rooms."""
        building, room = self.building, self.furnished[index]
        yield from room_shell(building, room, 1000 * self.seed + 100 * index)
        for passage in building.passages:
            if passage.rooms[0] == index:
                yield from passage_shell(building, passage, room.style.floor, room.style.trim)
        for piece in (*lamps(building, room), *(placed.quads() for placed in room.placed)):
            yield piece, None

    @cached_property
    def area(self) -> NavigableArea:
        """Where the robot may stand."""
        # Two triangles for every quad; cut ones whole, which adds nothing but floor and ceiling inside of walls.
        corners = [surface.quads.corners_m for surface in self.surfaces]
        triangles = [np.concatenate([own[:, [0, 1, 2]], own[:, [0, 2, 3]]]) for own in corners]
        return navigable_area(np.concatenate(triangles), DEFAULT_FOOTPRINT)

    @cached_property
    def reached(self) -> set[int]:
        """Rooms that the largest component gets into."""
        tree = shapely.STRtree(np.array([room.floor for room in self.building.rooms], dtype=object))
        _, room = tree.query(shapely.points(self.area.places(1)), predicate="within")
        counts = np.bincount(room, minlength=len(self.furnished)) * self.area.grid.resolution_m**2
        return {int(k) for k in np.flatnonzero(counts >= _MIN_REACHED_M2)}


def _reachable(building: Building, seed: int, furniture: bool) -> _Interior:
    """The furnished building, those rooms emptied that the robot would not get into otherwise."""

    def attempt(bare: frozenset[int], furniture: bool) -> _Interior:
        return _Interior(building, furnish(building, seed, bare, furniture), seed)

    bare: frozenset[int] = frozenset()
    interior = attempt(bare, furniture)
    everywhere = set(range(len(building.rooms)))
    if not furniture or interior.reached == everywhere:
        return interior
    # A plan may hold rooms that the robot does not fit into even when they are empty.
    reachable = attempt(bare, False).reached
    while missing := reachable - interior.reached:
        beside = {k for passage in building.passages if missing & set(passage.rooms) for k in passage.rooms}
        closed = missing | beside
        if closed <= bare:
            closed = everywhere
        bare |= closed
        _logger.info("emptied to let the robot through: %s", ", ".join(building.rooms[k].name for k in sorted(closed)))
        interior = attempt(bare, furniture)
    return interior


def _lighting(building: Building, furnished: list[FurnishedRoom]) -> VoxelLighting:
    """The light of all lamps and windows among all furniture."""
    x0, y0, x1, y1 = shapely.total_bounds([room.room.floor for room in furnished])
    origin = np.array([x0 - 0.3, y0 - 0.3, -0.16])
    end = np.array([x1 + 0.3, y1 + 0.3, building.ceiling_m + 0.16])
    cols, rows, layers = np.ceil((end - origin) / VOXEL_M).astype(int)
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
