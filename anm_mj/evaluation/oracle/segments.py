"""Segments of tours: turns at a place and paths between places, with the samples that their frames cover."""

import numpy as np
from jaxtyping import Int, Int8, Int32, UInt64

from anm_mj import _native
from anm_mj.evaluation.oracle.discretize import CLEARANCE_COST_STEPS, CLEARANCE_M, TOLERANCE_M, turn
from anm_mj.evaluation.oracle.roadmap import CLEARANCE_M as EDGE_CLEARANCE_M
from anm_mj.evaluation.oracle.roadmap import SAMPLE_M, Roadmap
from anm_mj.geometry.polyline import NUM_HEADINGS
from anm_mj.types import FORWARD_STEP_M, TURN_STEP_RAD

NO_YAW = -1
"""Stands for no yaw."""
FIRST_SEGMENTS = 1024
"""Initial capacity."""
PATH_RULE = np.array(
    [EDGE_CLEARANCE_M, SAMPLE_M, TOLERANCE_M, CLEARANCE_M, CLEARANCE_COST_STEPS, FORWARD_STEP_M, TURN_STEP_RAD]
)
"""The numbers that the engine makes paths by, as ``native/roadmap_path.h`` orders them."""


class Segments:
    """Turns and paths, made on first use. ``bits`` say what the frame at every place and yaw covers, a bit for each
    sample; yaw number 0 is ``yaw_rad``.
    """

    def __init__(self, bits: UInt64[np.ndarray, "p yaws words"], roadmap: Roadmap, yaw_rad: float) -> None:
        self.bits = bits
        self._roadmap = roadmap
        self._yaw_rad = yaw_rad
        places = len(bits)
        self.turns: Int32[np.ndarray, "p yaws yaws 2"] = np.full((places, NUM_HEADINGS, NUM_HEADINGS, 2), -1, np.int32)
        """Number of the turn at a place from a yaw to a yaw, to the right (0) or to the left (1); -1 = not made yet."""
        self.paths: Int32[np.ndarray, "p p"] = np.full((places, places), -1, np.int32)
        """Number of the path from one place to another; -1 = not made yet."""
        self.yaws: Int8[np.ndarray, "k 2"] = np.full((FIRST_SEGMENTS, 2), NO_YAW, np.int8)
        """First and last yaw of each path; ``NO_YAW`` if the places are so near that no move is made."""
        self.covers: UInt64[np.ndarray, "k words"] = np.zeros((FIRST_SEGMENTS, bits.shape[2]), np.uint64)
        """Samples that the frames of each segment cover, one frame after each of its actions."""
        self.steps: Int[np.ndarray, " k"] = np.zeros(FIRST_SEGMENTS, np.int64)
        """Actions of each segment."""
        self._num = 0

    def __len__(self) -> int:
        return self._num

    def clear(self) -> None:
        """Drop all segments; numbering restarts."""
        self.turns[:] = self.paths[:] = -1
        self._num = 0

    def turn(self, place: int, a: int, b: int, side: int) -> int:
        """Number of the turn from one yaw to another, to the left (1) or to the right (-1)."""
        key = (place, a, b, int(side > 0))
        if self.turns[key] < 0:
            yaws = turn(a, b, side)
            self.turns[key] = self._add(np.bitwise_or.reduce(self.bits[place, yaws], axis=0), len(yaws))
        return int(self.turns[key])

    def path(self, a: int, b: int) -> tuple[int, int, int]:
        """Number, first yaw and last yaw of the path from one place to another, without the turn before it.

        Both yaws are ``NO_YAW`` if the places are so near that no move is made.
        """
        if self.paths[a, b] < 0:
            steps, first, last, covers = self._path(a, b)
            self.paths[a, b] = self._add(covers, steps, first, last)
        number = int(self.paths[a, b])
        first, last = self.yaws[number].tolist()
        return number, first, last

    def _path(self, a: int, b: int) -> tuple[int, int, int, UInt64[np.ndarray, " words"]]:
        """Steps, first and last yaw, and what the frames of a path cover (``native/roadmap_path.h``)."""
        covers = np.zeros(self.bits.shape[2], np.uint64)
        roadmap = self._roadmap
        frame = np.array([*roadmap.origin_xy_m, roadmap.resolution_m, self._yaw_rad])
        grid = roadmap.clearance_m, roadmap.nearest_place, frame, PATH_RULE
        before, places_m = roadmap.before[a], roadmap.places_m
        return *_native.roadmap_path(np.array([a, b]), before, places_m, *grid, self.bits, covers), covers

    def _add(
        self, covers: UInt64[np.ndarray, " words"], steps: int, first_yaw: int = NO_YAW, last_yaw: int = NO_YAW
    ) -> int:
        if self._num == len(self.steps):
            self.covers = np.concatenate([self.covers, np.zeros_like(self.covers)])
            self.steps = np.concatenate([self.steps, np.zeros_like(self.steps)])
            self.yaws = np.concatenate([self.yaws, np.zeros_like(self.yaws)])
        self.covers[self._num], self.steps[self._num] = covers, steps
        self.yaws[self._num] = first_yaw, last_yaw
        self._num += 1
        return self._num - 1
