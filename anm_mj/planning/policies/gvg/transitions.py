"""Transitions between views: the steps from one to the next, and the gain of all that the camera sweeps on the way.

A transition leaves a place, goes to another, or stays, and turns there. While the camera turns, to leave or after
arrival, it sweeps over all azimuths in between and shows their gain. A patch of space that a tour has covered brings no
gain again.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from anm_mj.planning.policies.gvg.travel_costs import TravelCosts
from anm_mj.planning.policies.gvg.views import HALF_TURN, NUM_AZIMUTHS, signed_turns

TURNS = np.concatenate([np.arange(HALF_TURN + 1), -np.arange(HALF_TURN, 0, -1)])
"""Turns after arrival, to the left from 0 up, then to the right: indices ``t`` and ``-t`` hold the turns ``t`` and
``-t``."""


@dataclass(frozen=True)
class Places:
    """Places to look from; the first is where the robot stands."""

    xy_m: Float[np.ndarray, "k 2"]
    vertex: Int[np.ndarray, " k"]
    """Vertex of the graph; -1 for the robot's own place."""
    patch: Int[np.ndarray, "k rays"]
    """Patch of space that each ray hits; rays ordered by azimuth, then elevation."""
    gain_m2: Float32[np.ndarray, "k rays"]
    """Expected new surface of each ray [m2]."""


class TransitionTable:
    """Steps, headings and gains of the transitions between some places."""

    def __init__(
        self,
        places: Places,
        costs: TravelCosts,
        view_side: int,
        more_steps: Float[np.ndarray, "k azimuths"] | None = None,
    ) -> None:
        """Compute the costs of all pairs of places; a view covers ``view_side`` sectors beside its middle one.

        A step or turn costs ``more_steps`` beside itself while the camera looks along each sector at each place; None =
        nothing.
        """
        self.places = places
        """What it was made for."""
        self._view_side = view_side
        self._swept = np.arange(-HALF_TURN - view_side, HALF_TURN + view_side + 1)
        """Azimuth sectors that turns can sweep over, relative to the first heading."""
        counts = places.gain_m2 > 0.0
        names, number = np.unique(places.patch[counts], return_inverse=True)
        self.num_places = len(places.xy_m)
        self.num_patches = len(names) + 1
        """Patches with any gain; all others are counted as one."""
        patch = np.full(places.patch.shape, len(names))
        patch[counts] = number
        self._patch = patch.reshape(self.num_places, NUM_AZIMUTHS, -1)
        self._gain_m2 = places.gain_m2.reshape(self._patch.shape)
        self._steps, self._leave, self._arrive = costs.between(places.xy_m, places.vertex)
        if more_steps is None:
            more_steps = np.zeros((self.num_places, NUM_AZIMUTHS))
        self._turn_steps = _turn_steps(more_steps)
        each = np.arange(self.num_places)
        # A path is taken for half of what its ends are.
        more = more_steps[each[:, None], self._leave] + more_steps[each, self._arrive]
        self._steps = self._steps * (1.0 + 0.5 * more)

    def expand(
        self, place: Int[np.ndarray, " b"], heading: Int[np.ndarray, " b"], covered: Bool[np.ndarray, "b patches"]
    ) -> tuple[Int[np.ndarray, "b k"], Float[np.ndarray, "b k turns"], Float[np.ndarray, "b k turns"]]:
        """The transitions that tours can go on with, to each place and with each of ``TURNS`` after arrival.

        Each tour ends at a place and heading, an azimuth sector, and has covered some patches. Returns the azimuth
        sectors along which the robot arrives, steps, and gains [m2].
        """
        each = np.arange(len(place))
        sector_gain = np.where(covered.take(self._patch, axis=1), np.float32(0.0), self._gain_m2).sum(axis=3)
        turn_away = signed_turns(self._leave[place], heading[:, None])
        # A robot that stays only turns; its sweep is counted as that after arrival.
        turn_away[each, place] = 0
        sweep_here = self._sweep_gains(sector_gain[each, place], heading)
        leaving = sweep_here[each[:, None], turn_away] - sweep_here[:, :1]
        arrival = self._arrive[place]
        arrival[each, place] = heading
        sweep_there = self._sweep_gains(sector_gain, arrival)
        steps_away = self._turn_steps[place[:, None], heading[:, None], turn_away]
        steps_there = self._turn_steps[np.arange(self.num_places), arrival]
        steps = self._steps[place][:, :, None] + steps_away[:, :, None] + steps_there
        gain = leaving[:, :, None] + sweep_there
        gain[each, place] -= sweep_there[each, place, :1]
        return arrival, steps, gain

    def cover(
        self,
        covered: Bool[np.ndarray, "c patches"],
        start: tuple[Int[np.ndarray, " c"], Int[np.ndarray, " c"]],
        end: tuple[Int[np.ndarray, " c"], Int[np.ndarray, " c"]],
    ) -> None:
        """Mark in ``covered`` what transitions between two places and headings cover."""
        place, heading = start
        to, to_heading = end
        stays = place == to
        leave = np.where(stays, to_heading, self._leave[place, to])
        arrive = np.where(stays, heading, self._arrive[place, to])
        for where, first, last in ((place, heading, leave), (to, arrive, to_heading)):
            row, sector = self._sectors(first, last)
            covered[row[:, None], self._patch[where[row], sector]] = True

    def swept(
        self, heading: int, to: int, to_heading: int
    ) -> tuple[Bool[np.ndarray, " azimuths"], Bool[np.ndarray, " azimuths"]]:
        """Azimuth sectors that a robot at the first place newly sees on the way to a view: there, and at the end.

        It looks along ``heading`` now. The turn of one that stays counts as made at the end.
        """
        stays = to == 0
        leave, arrive = (heading, heading) if stays else (int(self._leave[0, to]), int(self._arrive[0, to]))
        here, there = np.zeros((2, NUM_AZIMUTHS), bool)
        for sectors, start, end in ((here, heading, leave), (there, arrive, to_heading)):
            sectors[self._sectors(np.array([start]), np.array([end]))[1]] = True
        known = self._sectors(np.array([heading]), np.array([heading]))[1]
        here[known] = False
        if stays:
            there[known] = False
        return here, there

    def _sectors(
        self, start: Int[np.ndarray, " c"], end: Int[np.ndarray, " c"]
    ) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
        """Which of some turns from one heading to another show which sectors."""
        turn = signed_turns(end, start)[:, None]
        side = self._view_side
        swept = (np.minimum(turn, 0) - side <= self._swept) & (np.maximum(turn, 0) + side >= self._swept)
        row, column = np.nonzero(swept)
        return row, (start[row] + self._swept[column]) % NUM_AZIMUTHS

    def _sweep_gains(
        self, sector_gain: Float[np.ndarray, "*n azimuths"], start: Int[np.ndarray, "*n"]
    ) -> Float[np.ndarray, "*n turns"]:
        """Gain of all that a camera shows that looks along ``start`` and then turns, for each of ``TURNS`` [m2]."""
        rolled = np.take_along_axis(sector_gain, (start[..., None] + self._swept) % NUM_AZIMUTHS, axis=-1).astype(float)
        width = 2 * self._view_side + 1
        middle = rolled[..., HALF_TURN : HALF_TURN + width].sum(axis=-1, keepdims=True)
        to_left = np.cumsum(rolled[..., HALF_TURN + width :], axis=-1)
        to_right = np.cumsum(rolled[..., HALF_TURN - 1 :: -1], axis=-1)
        return np.concatenate([middle, middle + to_left, (middle + to_right)[..., ::-1]], axis=-1)


def _turn_steps(more_steps: Float[np.ndarray, "k azimuths"]) -> Float[np.ndarray, "k azimuths turns"]:
    """Steps of each of ``TURNS`` from each sector at each place."""
    start = np.arange(NUM_AZIMUTHS)[:, None]
    away = np.arange(1, HALF_TURN + 1)
    to_left, to_right = (
        np.cumsum(1.0 + more_steps[:, (start + side * away) % NUM_AZIMUTHS], axis=2) for side in (1, -1)
    )
    return np.concatenate([np.zeros((*more_steps.shape, 1)), to_left, to_right[:, :, ::-1]], axis=2)
