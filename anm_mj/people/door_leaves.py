"""Door leaves on hinges: shut at first, opened by the first person who passes, and open from then on; one in whose
doorway the robot begins is open.

A leaf turns by 90 degrees, away from who opens it where there is room. It waits rather than turn into anybody.
"""

from __future__ import annotations

import copy
import math

import numpy as np
from jaxtyping import Float

from anm_mj.errors import SceneError
from anm_mj.people.walking_floor import Doorway, WalkingFloor
from anm_mj.types import Footprint

LEAF = Footprint(radius_m=0.02, z_min_m=0.01, z_max_m=2.0)
"""Half the thickness of a leaf, and where it begins and ends."""
_WIDTH_M = 0.6, 1.1
"""Leaves hang in doorways from so wide to so wide [m]."""
_SLIT_M = 0.02
"""Between leaf and jamb [m]."""
_OPEN_RAD, _TURN_RADPS = math.pi / 2, 1.5
_REACH_M, _PASS_M = 1.2, 0.4
"""Who is so near, and whose way leads so near past the middle, opens a leaf [m]."""
_WAY_PLACES = 15
"""So many of the next places on the way are looked at."""


class DoorLeaves:
    """The leaves of a scene; a copy moves on by itself."""

    def __init__(self, floor: WalkingFloor, number: int, start_m: Float[np.ndarray, "2"]) -> None:
        """Hang leaves in the doorways nearest to a place [m], all shut. Raises SceneError if there are fewer."""
        near = sorted(floor.doorways, key=lambda door: math.dist(door.middle_m, start_m)) if number else []
        hung = [hinge for door in near for hinge in _hinges(door, floor)[:1]][:number]
        if len(hung) < number:
            raise SceneError(
                f"people.doors is {number}, but {len(hung)} doorways of the scene have room for a leaf that turns; "
                "give no more."
            )
        self.hinge_m = np.array([hinge for hinge, *_ in hung], float).reshape(-1, 2)
        """Of each leaf [m]."""
        self.length_m = np.array([length_m for _, length_m, *_ in hung], float)
        self._shut_rad = np.array([yaw_rad for _, _, yaw_rad, _ in hung], float)
        self._sides = [sides for *_, sides in hung]
        """Signs of the turns for which each has room."""
        self._turned_rad = np.zeros(number)
        self._side = np.zeros(number)
        """Sign of the turn; 0 while a leaf is shut."""

    def __len__(self) -> int:
        return len(self.length_m)

    @property
    def yaw_rad(self) -> Float[np.ndarray, " n"]:
        """Direction from each hinge along its leaf."""
        return self._shut_rad + self._side * self._turned_rad

    @property
    def _tips_m(self) -> Float[np.ndarray, "n 2"]:
        return self.hinge_m + self.length_m[:, None] * np.column_stack([np.cos(self.yaw_rad), np.sin(self.yaw_rad)])

    @property
    def states(self) -> Float[np.ndarray, "n 4"]:
        """Of each leaf: x and y of the hinge [m], yaw [rad], length [m]."""
        return np.column_stack([self.hinge_m, self.yaw_rad, self.length_m])

    def copied(self) -> DoorLeaves:
        """The same leaves, to move on by themselves."""
        other = copy.copy(self)
        other._turned_rad, other._side = self._turned_rad.copy(), self._side.copy()
        return other

    def shut(self, body: Float[np.ndarray, "3"]) -> None:
        """Shut all but those in whose way a body stands, by x, y and radius [m]: they are open, to the side where it
        has more room.
        """
        self._turned_rad[:] = self._side[:] = 0.0
        for one, sides in enumerate(self._sides):
            if self._gaps_m(one, body[None])[0] < 0.0:
                self._turned_rad[one], gaps_m = _OPEN_RAD, {}
                for side in sides:
                    self._side[one] = side
                    gaps_m[side] = float(self._gaps_m(one, body[None])[0])
                self._side[one] = max(sides, key=gaps_m.__getitem__)

    def move(self, ways_m: list[Float[np.ndarray, "k 2"]], bodies: Float[np.ndarray, "b 3"], period_s: float) -> None:
        """Turn leaves that people walk towards, or that are turning, by one period [s], but into nobody.

        ``ways_m`` has of each person who walks its place and the next ones on its way, ``bodies`` x, y and radius of
        everybody, the robot too [m].
        """
        for one in range(len(self)):
            if not self._side[one]:
                self._side[one] = self._opened(one, ways_m)
            if not self._side[one] or self._turned_rad[one] >= _OPEN_RAD:
                continue
            before = self._turned_rad[one]
            gaps_m = self._gaps_m(one, bodies)
            self._turned_rad[one] = min(before + _TURN_RADPS * period_s, _OPEN_RAD)
            after_m = self._gaps_m(one, bodies)
            if ((after_m < 0.0) & (after_m < gaps_m)).any():
                self._turned_rad[one] = before

    def touches(self, start_m: Float[np.ndarray, "2"], end_m: Float[np.ndarray, "2"], radius_m: float) -> bool:
        """Whether a body would touch a leaf anywhere on a straight line, and come nearer to it by that."""
        tips_m = self._tips_m
        leaf_m = self.hinge_m, tips_m
        now_m = distance_from_line(start_m, *leaf_m)
        ends_m = distance_from_line(end_m, *leaf_m), *(distance_from_line(xy_m, start_m, end_m) for xy_m in leaf_m)
        is_crossed = (_side(start_m, *leaf_m) * _side(end_m, *leaf_m) < 0.0) & (
            _side(self.hinge_m, start_m, end_m) * _side(tips_m, start_m, end_m) < 0.0
        )
        nearest_m = np.where(is_crossed, 0.0, np.minimum.reduce([now_m, *ends_m]))
        return bool(((nearest_m < radius_m + LEAF.radius_m) & (nearest_m < now_m - 1e-6)).any())

    def _opened(self, one: int, ways_m: list[Float[np.ndarray, "k 2"]]) -> float:
        """Sign of the turn by which the first person opens a leaf whose way leads through; 0 = nobody does."""
        along = np.array([math.cos(self._shut_rad[one]), math.sin(self._shut_rad[one])])
        middle_m = self.hinge_m[one] + 0.5 * self.length_m[one] * along
        for way_m in ways_m:
            near = math.dist(way_m[0], middle_m) < _REACH_M
            if near and np.linalg.norm(way_m[: _WAY_PLACES + 1] - middle_m, axis=1).min() < _PASS_M:
                dx, dy = way_m[0] - middle_m
                away = -1.0 if along[0] * dy - along[1] * dx > 0.0 else 1.0
                return away if away in self._sides[one] else -away
        return 0.0

    def _gaps_m(self, one: int, bodies: Float[np.ndarray, "b 3"]) -> Float[np.ndarray, " b"]:
        """Between bodies, by x, y and radius, and a leaf [m]."""
        hinge_m, tip_m = self.hinge_m[one], self._tips_m[one]
        return distance_from_line(bodies[:, :2], hinge_m, tip_m) - bodies[:, 2] - LEAF.radius_m


def distance_from_line(
    places_m: Float[np.ndarray, "... 2"], starts_m: Float[np.ndarray, "... 2"], ends_m: Float[np.ndarray, "... 2"]
) -> Float[np.ndarray, "..."]:
    """Between places and straight lines from starts to ends [m]."""
    along, away = ends_m - starts_m, places_m - starts_m
    share = ((away * along).sum(axis=-1) / (along**2).sum(axis=-1).clip(1e-12)).clip(0.0, 1.0)
    return np.linalg.norm(away - share[..., None] * along, axis=-1)


def _side(
    places_m: Float[np.ndarray, "... 2"], starts_m: Float[np.ndarray, "... 2"], ends_m: Float[np.ndarray, "... 2"]
) -> Float[np.ndarray, "..."]:
    """Positive for places to the left of the lines from starts to ends, negative to the right [m2]."""
    along, away = ends_m - starts_m, places_m - starts_m
    return along[..., 0] * away[..., 1] - along[..., 1] * away[..., 0]


def _hinges(door: Doorway, floor: WalkingFloor) -> list[tuple[Float[np.ndarray, "2"], float, float, tuple[float, ...]]]:
    """Hinge [m], length [m], shut yaw [rad] and signs of possible turns of leaves for a doorway, most room first."""
    width_m = math.dist(door.left_m, door.right_m)
    if not _WIDTH_M[0] <= width_m <= _WIDTH_M[1]:
        return []
    found = []
    for jamb_m, other_m in ((door.left_m, door.right_m), (door.right_m, door.left_m)):
        along = (other_m - jamb_m) / width_m
        hinge_m, length_m = jamb_m + _SLIT_M * along, width_m - 2 * _SLIT_M
        shut_rad = math.atan2(along[1], along[0])
        sides = tuple(side for side in (1.0, -1.0) if _has_room(hinge_m, length_m, shut_rad, side, floor))
        if sides:
            found.append((hinge_m, length_m, shut_rad, sides))
    return sorted(found, key=lambda hinge: -len(hinge[3]))


def _has_room(
    hinge_m: Float[np.ndarray, "2"], length_m: float, shut_rad: float, side: float, floor: WalkingFloor
) -> bool:
    """Whether a leaf can turn to one side without touching furniture."""
    for turned_rad in np.linspace(0.25, 1.0, 4) * _OPEN_RAD:
        yaw_rad = shut_rad + side * turned_rad
        # The end at the hinge lies beside the jamb.
        for reach_m in np.linspace(0.4, 1.0, 5) * length_m:
            place = hinge_m + reach_m * np.array([math.cos(yaw_rad), math.sin(yaw_rad)])
            if floor.clearance(*place.tolist())[0] <= 2 * LEAF.radius_m:
                return False
    return True
