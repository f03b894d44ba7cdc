"""Upright walls as seen from inside a room."""

import itertools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from anm_mj.scene.generation.quads import Material, Point, Quads, box, rectangle


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
