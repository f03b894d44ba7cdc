"""Upright walls as seen from inside a room: holes, skirting, door casings and windows."""

import itertools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from anm_mj.scene.generation.quads import Material, Parts, Point, Quads, box, rectangle

WINDOW_DEPTH_M = 0.14
SKIRTING_HEIGHT_M = 0.08
SKIRTING_DEPTH_M = 0.012
CASING_WIDTH_M = 0.07
CASING_DEPTH_M = 0.015


@dataclass(frozen=True)
class WallArea:
    """A rectangle in a wall's own coordinates: along it, and z."""

    start_m: float
    end_m: float
    z_low_m: float
    z_high_m: float


@dataclass(frozen=True)
class Wall:
    """A room's wall as seen from inside: it begins at the left end and runs to the right."""

    left_m: tuple[float, float]
    right_m: tuple[float, float]

    @property
    def length_m(self) -> float:
        """Distance between its ends [m]."""
        return float(np.hypot(self.right_m[0] - self.left_m[0], self.right_m[1] - self.left_m[1]))

    @property
    def along(self) -> tuple[float, float]:
        """Unit vector from left to right; the room lies to the right of it."""
        return (self.right_m[0] - self.left_m[0]) / self.length_m, (self.right_m[1] - self.left_m[1]) / self.length_m

    @property
    def yaw_deg(self) -> float:
        """Direction from left to right, and yaw of a piece whose back is to the wall [degrees]."""
        return float(np.degrees(np.arctan2(self.right_m[1] - self.left_m[1], self.right_m[0] - self.left_m[0])))

    def upright(self, area: WallArea, material: Material) -> Quads:
        """A rectangle on the wall's face."""
        (x, y), span, height = self.along, area.end_m - area.start_m, area.z_high_m - area.z_low_m
        corner = self.point(area.start_m, 0.0, area.z_low_m)
        return rectangle(corner, (x * span, y * span, 0.0), (0.0, 0.0, height), material, (area.start_m, area.z_low_m))

    def block(self, area: WallArea, front_m: float, material: Material, skip: str) -> Quads:
        """A box on the wall's face; in ``skip``, x runs along the wall, +y is its back, against the wall."""
        piece = box((area.start_m, -front_m, area.z_low_m), (area.end_m, 0.0, area.z_high_m), material, skip)
        x, y = self.along
        return piece.placed(self.left_m[0], self.left_m[1], float(np.degrees(np.arctan2(y, x))))

    def point(self, along_m: float, inward_m: float, z_m: float) -> Point:
        """World coordinates of a place given along the wall, inward from it, and by height."""
        x, y = self.along
        return self.left_m[0] + x * along_m + y * inward_m, self.left_m[1] + y * along_m - x * inward_m, z_m


def between(gaps_m: Iterable[tuple[float, float]], length_m: float) -> list[tuple[float, float]]:
    """The stretches of a length that gaps (start, end), in order, leave [m]."""
    ends = [0.0, *itertools.chain.from_iterable(gaps_m), length_m]
    return [(a, b) for a, b in zip(ends[::2], ends[1::2], strict=True) if b - a > 1e-6]


def around_holes(length_m: float, holes: list[WallArea], ceiling_m: float) -> list[WallArea]:
    """The rectangles that make up a wall above its skirting, without its holes."""
    areas, start = [], 0.0
    for hole in sorted(holes, key=lambda hole: hole.start_m):
        areas.append(WallArea(start, hole.start_m, SKIRTING_HEIGHT_M, ceiling_m))
        areas.append(WallArea(hole.start_m, hole.end_m, hole.z_high_m, ceiling_m))
        if hole.z_low_m > 0.0:
            areas.append(WallArea(hole.start_m, hole.end_m, SKIRTING_HEIGHT_M, hole.z_low_m))
        start = hole.end_m
    areas.append(WallArea(start, length_m, SKIRTING_HEIGHT_M, ceiling_m))
    return [area for area in areas if area.end_m - area.start_m > 1e-6 and area.z_high_m - area.z_low_m > 1e-6]


def casing(wall: Wall, door: WallArea, trim: Material) -> Parts:
    """The frame about a door opening: two posts and a head."""
    left, right, top = door.start_m - CASING_WIDTH_M, door.end_m + CASING_WIDTH_M, door.z_high_m
    yield wall.block(WallArea(left, door.start_m, 0.0, top), CASING_DEPTH_M, trim, "-z +y +z")
    yield wall.block(WallArea(door.end_m, right, 0.0, top), CASING_DEPTH_M, trim, "-z +y +z")
    yield wall.block(WallArea(left, right, top, top + CASING_WIDTH_M), CASING_DEPTH_M, trim, "+y")


def niche(wall: Wall, hole: WallArea, pane: Material, trim: Material) -> Parts:
    """A window: pane, reveals, sill, and the bars that divide it, 3 cm before the pane."""
    depth, bar = WINDOW_DEPTH_M, 0.04
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
