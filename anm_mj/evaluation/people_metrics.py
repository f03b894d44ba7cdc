"""How a run got on with the people in its scene: distance, contacts, which pixels it took for moved, and how much of
the observed surface its map has carved away, such as where somebody walked before a wall.
"""

import itertools
import math
from typing import Any

import numpy as np
from jaxtyping import Float

from anm_mj.types import FREE, OCCUPIED, ActionResult, Observation, OccupancyGrid, PixelState, TrueView

IN_VIEW_FRAMES = 5
"""Moved pixels are judged once somebody was in view for so many frames in a row."""
_IN_VIEW_SHARE = 1e-3
"""Somebody is in view who fills this share of the image."""
_REACH = 2
"""A sample counts as observed up to 5 cm from what was measured: two voxels away, where it lies at an edge."""


class PeopleStatistics:
    """Sums over the frames and steps of a run."""

    def __init__(self) -> None:
        self.nearest_m = math.inf
        """Smallest distance between the robot's body and a person's [m]."""
        self.contacts = 0
        """Steps by which the robot ran into somebody."""
        self._frames_in_view = 0
        self._found = self._right = self._shown = 0

    def add(self, observation: Observation, true: TrueView | None) -> None:
        """Take in an observation."""
        if true is None or true.people is None:
            return
        self.nearest_m = min(self.nearest_m, true.people.nearest_m)
        shown = true.people.shown
        self._frames_in_view = self._frames_in_view + 1 if shown.mean() > _IN_VIEW_SHARE else 0
        if self._frames_in_view <= IN_VIEW_FRAMES or observation.pixel_state is None:
            return
        moved = observation.pixel_state == PixelState.MOVED
        told = moved | (observation.pixel_state == PixelState.MEASURED)
        if true.people.standing_shown is not None:
            moved, told = moved & ~true.people.standing_shown, told & ~true.people.standing_shown
        self._found += int(np.count_nonzero(moved))
        self._right += int(np.count_nonzero(moved & shown))
        self._shown += int(np.count_nonzero(shown & told))

    def step(self, result: ActionResult) -> None:
        """Take in what an action did."""
        self.contacts += result.met_person

    def metrics(self) -> dict[str, Any]:
        """The keys of ``metrics.json``; none of a run among nobody."""
        if not math.isfinite(self.nearest_m):
            return {}
        return {
            "people_nearest_m": self.nearest_m,
            "people_contacts": self.contacts,
            "moved_precision_percent": 100.0 * self._right / self._found if self._found else None,
            "moved_recall_percent": 100.0 * self._right / self._shown if self._shown else None,
        }


def surface_lost_percent(grid: OccupancyGrid, samples_m: Float[np.ndarray, "n 3"]) -> float | None:
    """Share of points on the observed surface that the map takes for free, with nothing occupied near them [%]. None of
    no points.
    """
    last = np.array(grid.state.shape[::-1]) - 1
    cells = np.floor((samples_m - grid.origin_m) / grid.resolution_m).astype(np.int64)
    if not len(cells) or (last < 0).any():
        return None
    col, row, layer = cells.clip(0, last).T
    lost = cells[(grid.state[layer, row, col] == FREE) & ((cells >= 0) & (cells <= last)).all(axis=1)]
    for offset in itertools.product(range(-_REACH, _REACH + 1), repeat=3):
        col, row, layer = (lost + offset).clip(0, last).T
        lost = lost[grid.state[layer, row, col] != OCCUPIED]
    return 100.0 * len(lost) / len(cells)
