"""The project's own scenes: a furnished house of seven rooms, and a small one of two rooms for tests."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from anm_mj.scene.folder import Scene
from anm_mj.scene.generation.furniture.atlas import paint
from anm_mj.scene.generation.furniture.decor import ceiling_lamp
from anm_mj.scene.generation.furniture.light import Light, Lighting, ceiling_light, window_light
from anm_mj.scene.generation.furniture.quads import Quads, join
from anm_mj.scene.generation.furniture.textures import rgb
from anm_mj.scene.home.layout import CEILING_M, Doorway, Room, doorway_passage, room_shell
from anm_mj.scene.home.plan import home_doorways, home_rooms, small_doorways, small_rooms
from anm_mj.scene.home.rooms import furnish
from anm_mj.scene.submesh import Part
from anm_mj.scene.writer import SceneInfo, write_scene
from anm_mj.types import Pose2

HOME_STARTS = (Pose2(4.9, 2.2, math.radians(180.0)), Pose2(7.0, 4.85, 0.0), Pose2(2.6, 6.3, math.radians(90.0)))
"""In the living room behind the sofa, in the hall, in the bedroom beside the bed."""
_LICENCE = "MIT"


def make_home(out: Path) -> Scene:
    """Write the house of seven rooms as a scene folder; the same bytes every time; about a minute.

    Raises:
        SceneError: if the folder cannot be written (RayCastError: embreex is missing).
    """
    parts = build(home_rooms(), home_doorways(), light_spacing_m=0.06, num_rays=64)
    info = SceneInfo("home", "anm_mj.scene.home", _LICENCE, rooms=len(home_rooms()), budget_steps=1000, cull_face=True)
    return write_scene(parts, info, out, HOME_STARTS)


def make_small_scene(out: Path) -> Scene:
    """Write a furnished scene of two rooms of 3 m by 3 m as a scene folder, quickly, for tests.

    Raises:
        SceneError: if the folder cannot be written (RayCastError: embreex is missing).
    """
    parts = build(small_rooms(), small_doorways(), light_spacing_m=0.3, num_rays=12, coarser=2.0)
    info = SceneInfo("small", "anm_mj.scene.home", _LICENCE, rooms=2, budget_steps=200, cull_face=True)
    return write_scene(parts, info, out, (Pose2(1.0, 0.8, math.radians(90.0)), Pose2(4.6, 1.5, math.radians(180.0))))


def build(
    rooms: list[Room], doorways: list[Doorway], light_spacing_m: float, num_rays: int, coarser: float = 1.0
) -> list[Part]:
    """One textured part per room.

    Args:
        rooms: Rooms of the house.
        doorways: Openings between them.
        light_spacing_m: Distance of the points that light is worked out for.
        num_rays: Rays per such point.
        coarser: Factor on the size of all texels.

    Raises:
        RayCastError: if embreex is missing.
    """
    surfaces = furnished_rooms(rooms, doorways)
    corners = np.concatenate([surface.corners_m for surface in surfaces.values()])
    triangles = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    lighting = Lighting(triangles, [light for room in rooms for light in _lights(room)], num_rays)
    return [
        paint(name, _coarsened(_visible(surface, lighting), coarser), lighting, light_spacing_m)
        for name, surface in surfaces.items()
    ]


def furnished_rooms(rooms: list[Room], doorways: list[Doorway]) -> dict[str, Quads]:
    """All surfaces by the name of the room they belong to; a passage belongs to the first room that it opens into."""
    surfaces = {room.name: join(room_shell(room, doorways), furnish(room), _lamp(room)) for room in rooms}
    for doorway in doorways:
        owner = next(room for room in rooms if _touches(room, doorway))
        surfaces[owner.name] = join(surfaces[owner.name], doorway_passage(doorway, owner.finish))
    return surfaces


def _lamp(room: Room) -> Quads:
    return ceiling_lamp(CEILING_M, rgb("fff4d6")).placed(*room.centre_m)


def _lights(room: Room) -> list[Light]:
    """The room's lamp and windows; larger rooms have a brighter lamp."""
    (x0, y0), (x1, y1) = room.low_m, room.high_m
    area = (x1 - x0) * (y1 - y0)
    lights = [ceiling_light(*room.centre_m, CEILING_M - 0.14, 0.5 + 0.09 * area)]
    for window in room.windows:
        z, height = (window.z_low_m + window.z_high_m) / 2, window.z_high_m - window.z_low_m
        place = {
            "south": ((window.centre_m, y0 + 0.02, z), (-1.0, 0.0)),
            "north": ((window.centre_m, y1 - 0.02, z), (1.0, 0.0)),
            "west": ((x0 + 0.02, window.centre_m, z), (0.0, 1.0)),
            "east": ((x1 - 0.02, window.centre_m, z), (0.0, -1.0)),
        }
        centre, along = place[window.side]
        lights.append(window_light(centre, along, window.width_m, height, 0.9 * window.width_m * height))
    return lights


def _touches(room: Room, doorway: Doorway) -> bool:
    """Whether a doorway's middle lies within a wall's thickness of the room's floor."""
    x, y = (doorway.centre_m, doorway.line_m) if doorway.along == "x" else (doorway.line_m, doorway.centre_m)
    (x0, y0), (x1, y1) = room.low_m, room.high_m
    return x0 - 0.1 < x < x1 + 0.1 and y0 - 0.1 < y < y1 + 0.1


def _visible(surface: Quads, lighting: Lighting) -> Quads:
    """The quads that are not enclosed in other bodies, as a mattress under its blanket is."""
    spots = np.array([0.08, 0.5, 0.92])
    s, t = (grid.ravel()[None, :, None] for grid in np.meshgrid(spots, spots))
    a, b, c, d = (surface.corners_m[:, None, k] for k in range(4))
    points = (a * (1 - s) + b * s) * (1 - t) + (d * (1 - s) + c * s) * t
    normals = np.repeat(surface.normals, points.shape[1], axis=0)
    enclosed = lighting.enclosed(points.reshape(-1, 3), normals).reshape(points.shape[:2])
    kept = np.flatnonzero(~enclosed.all(axis=1))
    return Quads(surface.corners_m[kept], surface.uv_m[kept], tuple(surface.materials[k] for k in kept))


def _coarsened(surface: Quads, factor: float) -> Quads:
    """The same surface with larger texels."""
    larger = {material: replace(material, texel_m=material.texel_m * factor) for material in set(surface.materials)}
    return Quads(surface.corners_m, surface.uv_m, tuple(larger[material] for material in surface.materials))
