"""Upright walls as seen from inside a room: holes, skirting, door casings and windows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anm_mj.scene.generation.quads import Material, Quads, box, rectangle

WINDOW_DEPTH_M = 0.14
SKIRTING_HEIGHT_M = 0.08
SKIRTING_DEPTH_M = 0.012
CASING_WIDTH_M = 0.07
CASING_DEPTH_M = 0.015


@dataclass(frozen=True)
class Hole:
    """A rectangle left out of a wall, in the wall's own coordinates: along it, and z."""

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

    def upright(
        self, start_m: float, end_m: float, z_low_m: float, z_high_m: float, material: Material, depth_m: float = 0.0
    ) -> Quads:
        """A rectangle on the wall, ``depth_m`` behind its face."""
        corner = self.point(start_m, -depth_m, z_low_m)
        along, _ = self._axes()
        span = end_m - start_m
        return rectangle(
            corner,
            (along[0] * span, along[1] * span, 0.0),
            (0.0, 0.0, z_high_m - z_low_m),
            material,
            (start_m, z_low_m),
        )

    def block(
        self,
        start_m: float,
        end_m: float,
        z_low_m: float,
        z_high_m: float,
        front_m: float,
        material: Material,
        skip: str,
    ) -> Quads:
        """A box on the wall's face; in ``skip``, x runs along the wall, +y is its back, against the wall."""
        piece = box((start_m, -front_m, z_low_m), (end_m, 0.0, z_high_m), material, skip)
        along, _ = self._axes()
        yaw = float(np.degrees(np.arctan2(along[1], along[0])))
        return piece.placed(self.left_m[0], self.left_m[1], yaw)

    def point(self, along_m: float, inward_m: float, z_m: float) -> tuple[float, float, float]:
        """World coordinates of a place given along the wall, inward from it, and by height."""
        along, inward = self._axes()
        return (
            self.left_m[0] + along[0] * along_m + inward[0] * inward_m,
            self.left_m[1] + along[1] * along_m + inward[1] * inward_m,
            z_m,
        )

    def _axes(self) -> tuple[tuple[float, float], tuple[float, float]]:
        x = (self.right_m[0] - self.left_m[0]) / self.length_m
        y = (self.right_m[1] - self.left_m[1]) / self.length_m
        return (x, y), (y, -x)


def around_holes(length_m: float, holes: list[Hole], ceiling_m: float) -> list[tuple[float, float, float, float]]:
    """Rectangles (start, end, z_low, z_high) that make up a wall above its skirting, without its holes.

    The wall's foot is hidden by the skirting and left out.
    """
    rectangles = []
    start = 0.0
    for hole in sorted(holes, key=lambda hole: hole.start_m):
        rectangles.append((start, hole.start_m, SKIRTING_HEIGHT_M, ceiling_m))
        rectangles.append((hole.start_m, hole.end_m, hole.z_high_m, ceiling_m))
        if hole.z_low_m > 0.0:
            rectangles.append((hole.start_m, hole.end_m, SKIRTING_HEIGHT_M, hole.z_low_m))
        start = hole.end_m
    return [*rectangles, (start, length_m, SKIRTING_HEIGHT_M, ceiling_m)]


def casing(wall: Wall, door: Hole, trim: Material) -> list[Quads]:
    """The frame about a door opening: two posts and a head."""
    top = door.z_high_m
    return [
        wall.block(door.start_m - CASING_WIDTH_M, door.start_m, 0.0, top, CASING_DEPTH_M, trim, "-z +y +z"),
        wall.block(door.end_m, door.end_m + CASING_WIDTH_M, 0.0, top, CASING_DEPTH_M, trim, "-z +y +z"),
        wall.block(
            door.start_m - CASING_WIDTH_M,
            door.end_m + CASING_WIDTH_M,
            top,
            top + CASING_WIDTH_M,
            CASING_DEPTH_M,
            trim,
            "+y",
        ),
    ]


def niche(wall: Wall, hole: Hole, pane: Material, trim: Material) -> list[Quads]:
    """A window: reveals, sill, pane, and the bars that divide it."""
    depth, bar = WINDOW_DEPTH_M, 0.04
    start, end, low, high = hole.start_m, hole.end_m, hole.z_low_m, hole.z_high_m
    width, height = end - start, high - low
    glass = rectangle(
        wall.point(start, -depth, low),
        _difference(wall.point(end, -depth, low), wall.point(start, -depth, low)),
        (0.0, 0.0, height),
        pane,
    )
    inward = _difference(wall.point(0.0, depth, 0.0), wall.point(0.0, 0.0, 0.0))
    outward = (-inward[0], -inward[1], 0.0)
    across = _difference(wall.point(width, 0.0, 0.0), wall.point(0.0, 0.0, 0.0))
    bars = [((start + end) / 2 - bar / 2, (start + end) / 2 + bar / 2, low, high)]
    bars += [(start, start + bar, low, high), (end - bar, end, low, high)]
    return [
        glass,
        rectangle(wall.point(start, 0.0, low), across, outward, trim),
        rectangle(wall.point(start, 0.0, high), outward, across, trim),
        rectangle(wall.point(start, 0.0, low), outward, (0.0, 0.0, height), trim),
        rectangle(wall.point(end, -depth, low), inward, (0.0, 0.0, height), trim),
        wall.block(start - 0.05, end + 0.05, low - 0.03, low, 0.06, trim, "+y"),
        *(_bar(wall, extent, depth, trim) for extent in bars),
    ]


def _bar(wall: Wall, extent_m: tuple[float, float, float, float], depth_m: float, trim: Material) -> Quads:
    """A window bar that stands 3 cm before the pane."""
    behind = Wall(wall.point(0.0, -depth_m, 0.0)[:2], wall.point(wall.length_m, -depth_m, 0.0)[:2])
    start, end, low, high = extent_m
    return behind.block(start, end, low, high, 0.03, trim, "+y -z +z")


def _difference(a: tuple[float, float, float], b: tuple[float, float, float]) -> tuple[float, float, float]:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]
