"""Pieces that tours are made of: turns at a place and ways between places, with what their frames cover."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int, UInt64

from anm_mj.evaluation.oracle.discretize import turned, walk
from anm_mj.evaluation.oracle.roadmap import Ways
from anm_mj.evaluation.pixel_rays import NUM_YAWS

NO_YAW = -1
"""Stands for no yaw at all."""
FIRST_PIECES = 1024
"""Room for so many at first."""


class Pieces:
    """Turns and ways, made when first asked for.

    Args:
        bits: What the frame at every place and yaw covers, a bit for each sample.
        ways: Between the places.
        yaw_rad: Of yaw number 0.
    """

    def __init__(self, bits: UInt64[np.ndarray, "p yaws words"], ways: Ways, yaw_rad: float) -> None:
        self.bits = bits
        self._ways = ways
        self._yaw_rad = yaw_rad
        self._turns: dict[tuple[int, int, int], int] = {}
        self._walks: dict[tuple[int, int], tuple[int, int, int]] = {}
        self.covers: UInt64[np.ndarray, "k words"] = np.zeros((FIRST_PIECES, bits.shape[2]), np.uint64)
        """What each piece covers: the frame after each of its actions."""
        self.steps: Int[np.ndarray, " k"] = np.zeros(FIRST_PIECES, np.int64)
        """Its actions."""
        self._num = 0

    def __len__(self) -> int:
        return self._num

    def clear(self) -> None:
        """Forget all pieces; their numbers begin anew."""
        self._turns.clear()
        self._walks.clear()
        self._num = 0

    def turn(self, place: int, a: int, b: int, side: int) -> int:
        """A turn from one yaw to another, to the left (1) or to the right (-1): the piece's number."""
        key = (place, a * NUM_YAWS + b, side)
        found = self._turns.get(key)
        if found is None:
            yaws = turned(a, b, side)
            found = self._add(np.bitwise_or.reduce(self.bits[place, yaws], axis=0), len(yaws))
            self._turns[key] = found
        return found

    def walk(self, a: int, b: int) -> tuple[int, int, int]:
        """A way from one place to another, without the turn before it: the piece's number, first yaw, last yaw.

        Both are ``NO_YAW`` where the places are so near that no move is made.
        """
        found = self._walks.get((a, b))
        if found is None:
            start_m = self._ways.places_m[a]
            way = walk(start_m, None, self._ways.corners_m(a, b), self._ways, self._yaw_rad)
            if way.yaws:
                xy_m, yaws = way.frames(start_m, way.yaws[0], self._yaw_rad)
                covers = np.bitwise_or.reduce(self.bits[self._ways.nearest(xy_m), yaws], axis=0)
                found = (self._add(covers, len(yaws)), way.yaws[0], way.yaws[-1])
            else:
                found = (self._add(np.zeros(self.bits.shape[2], np.uint64), 0), NO_YAW, NO_YAW)
            self._walks[a, b] = found
        return found

    def _add(self, covers: UInt64[np.ndarray, " words"], steps: int) -> int:
        if self._num == len(self.steps):
            self.covers = np.concatenate([self.covers, np.zeros_like(self.covers)])
            self.steps = np.concatenate([self.steps, np.zeros_like(self.steps)])
        self.covers[self._num], self.steps[self._num] = covers, steps
        self._num += 1
        return self._num - 1
