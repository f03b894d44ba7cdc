"""Which views to take in which order: a search over short sequences with imagined coverage.

A step of a sequence walks to a place and turns there. While it turns, leaving one place or arriving at the next, the
camera sweeps over all azimuths in between, so that their gain comes with the turn. What one view of the sequence would
show is not counted again for the later ones. The worth of a sequence is its gain, each part discounted by the steps
until it is had: near gains first, but near *and* on the way to more before near alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from anm_mj.planning.policies.gvg.travel_costs import HALF_TURN, NUM_AZIMUTHS, TravelCosts

SIDE = 4
"""Sectors to either side of the middle one that a view of 90 degrees takes in."""


@dataclass(frozen=True)
class Places:
    """Candidate places; the first is where the robot stands."""

    xy_m: Float[np.ndarray, "k 2"]
    vertex: Int[np.ndarray, " k"]
    """Vertex of the graph; -1 for the robot's own place."""
    patch: Int[np.ndarray, "k rays"]
    """What each ray meets; rays ordered by azimuth, then elevation."""
    worth: Float32[np.ndarray, "k rays"]
    """What each ray would add [m2]."""


@dataclass(frozen=True)
class Stop:
    """One step of a sequence: a place, the heading turned to there, and what had come together by then."""

    place: int
    heading: int
    """Azimuth sector."""
    gain_m2: float
    """Expected between the stop before and this one, its turns included [m2]."""
    at_step: float


@dataclass(frozen=True)
class Tour:
    """A sequence of stops and its worth."""

    stops: tuple[Stop, ...]
    value: float

    @property
    def gain_m2(self) -> float:
        """What it brings in all [m2]."""
        return sum(stop.gain_m2 for stop in self.stops)

    @property
    def rate(self) -> float:
        """What it brings per step [m2]."""
        return self.gain_m2 / max(self.stops[-1].at_step, 1.0)


@dataclass(frozen=True)
class _Beam:
    """Tours that are grown together."""

    tours: list[Tour]
    place: Int[np.ndarray, " b"]
    heading: Int[np.ndarray, " b"]
    """Azimuth sector looked along at the end."""
    steps: Float[np.ndarray, " b"]
    factor: Float[np.ndarray, "b k"]
    """On the worth of what comes next at each place: where a tour has begun, it is that of its first place."""
    shown: Bool[np.ndarray, "b patches"]

    @property
    def value(self) -> Float[np.ndarray, " b"]:
        """Worth of each tour."""
        return np.array([tour.value for tour in self.tours])


@dataclass(frozen=True)
class _Next:
    """The best view at each place after each tour of a beam."""

    value: Float[np.ndarray, "b k"]
    """What it adds to the worth of the tour."""
    heading: Int[np.ndarray, "b k"]
    steps: Float[np.ndarray, "b k"]
    gain_m2: Float[np.ndarray, "b k"]


class TourSearch:
    """Beam search over sequences of views among a few places."""

    def __init__(
        self, places: Places, ways: TravelCosts, *, discount_steps: float, preferred: Float[np.ndarray, " k"]
    ) -> None:
        """Work out all pairs of ways.

        Args:
            places: where to look from.
            ways: how these are joined.
            discount_steps: gain had after this many steps counts 1/e.
            preferred: factor on the worth of sequences that begin at each place: hysteresis.
        """
        self._discount_steps = discount_steps
        self._preferred = preferred
        counts = places.worth > 0.0
        names, found = np.unique(places.patch[counts], return_inverse=True)
        self._num_patches = len(names) + 1
        # What adds nothing shares one more patch.
        patch = np.full(places.patch.shape, len(names))
        patch[counts] = found
        self._patch = patch.reshape(len(places.xy_m), NUM_AZIMUTHS, -1)
        self._worth = places.worth.reshape(self._patch.shape)
        self._steps, self._leave, self._arrive = ways.between(places.xy_m, places.vertex)

    def best(self, heading: int, *, depth: int, width: int) -> list[Tour]:
        """The best tours found for a robot that looks along an azimuth sector, best first.

        Args:
            heading: azimuth sector the robot looks along now.
            depth: most stops in a tour.
            width: tours kept at each depth.
        """
        shown = np.zeros((1, self._num_patches), bool)
        beam = _Beam([Tour((), 0.0)], np.array([0]), np.array([heading]), np.zeros(1), self._preferred[None], shown)
        found: list[Tour] = []
        for _ in range(depth):
            after = self._expand(beam)
            tour, place = np.nonzero(after.value > 0.0)
            added = after.value[tour, place]
            best = np.lexsort((-added, tour, -(beam.value[tour] + added)))[:width]
            if not len(best):
                break
            beam = self._go(beam, after, tour[best], place[best])
            found += beam.tours
        return sorted(found, key=lambda tour: -tour.value)

    def _expand(self, beam: _Beam) -> _Next:
        """What may come next."""
        each, place = np.arange(len(beam.tours)), beam.place
        left = np.where(beam.shown.take(self._patch, axis=1), np.float32(0.0), self._worth).sum(axis=3)
        turn_away = _turns(self._leave[place], beam.heading[:, None])
        # Where the robot stays, it only turns; the sweep is then that of the arrival.
        turn_away[each, place] = 0
        here = _swept(left[each, place], beam.heading)
        away = here[each[:, None], turn_away] - here[:, :1]
        arrive = self._arrive[place]
        arrive[each, place] = beam.heading
        at = _swept(left, arrive)
        steps = self._steps[place][:, :, None] + np.abs(turn_away)[:, :, None] + np.abs(_TURNS)
        gain = away[:, :, None] + at
        gain[each, place] -= at[each, place, :1]
        added = gain * np.exp(-(beam.steps[:, None, None] + steps) / self._discount_steps)
        added[steps < 0.5] = 0.0
        added *= beam.factor[:, :, None]
        turn = added.argmax(axis=2)
        best = each[:, None], np.arange(len(self._worth)), turn
        return _Next(added[best], (arrive + _TURNS[turn]) % NUM_AZIMUTHS, steps[best], gain[best])

    def _go(self, beam: _Beam, after: _Next, tour: Int[np.ndarray, " c"], place: Int[np.ndarray, " c"]) -> _Beam:
        """The tours that some of a beam become at their next places."""
        chosen = tour, place
        heading, steps, gain = after.heading[chosen], beam.steps[tour] + after.steps[chosen], after.gain_m2[chosen]
        factor = beam.factor[chosen]
        before, looks = beam.place[tour], beam.heading[tour]
        stays = before == place
        shown = beam.shown[tour]
        self._show(shown, before, looks, np.where(stays, heading, self._leave[before, place]))
        self._show(shown, place, np.where(stays, looks, self._arrive[before, place]), heading)
        tours = [
            Tour(
                (*beam.tours[t].stops, Stop(int(p), int(h), float(g), float(s))),
                beam.tours[t].value + float(g) * math.exp(-s / self._discount_steps) * float(f),
            )
            for t, p, h, g, s, f in zip(tour, place, heading, gain, steps, factor, strict=True)
        ]
        return _Beam(tours, place, heading, steps, np.repeat(factor[:, None], len(self._worth), axis=1), shown)

    def _show(
        self,
        shown: Bool[np.ndarray, "c patches"],
        place: Int[np.ndarray, " c"],
        start: Int[np.ndarray, " c"],
        end: Int[np.ndarray, " c"],
    ) -> None:
        """Mark what turns at some places sweep over."""
        turn = _turns(end, start)[:, None]
        swept = (np.minimum(turn, 0) - SIDE <= _SWEPT) & (np.maximum(turn, 0) + SIDE >= _SWEPT)
        row, column = np.nonzero(swept)
        shown[row[:, None], self._patch[place[row], (start[row] + _SWEPT[column]) % NUM_AZIMUTHS]] = True


_TURNS = np.concatenate([np.arange(HALF_TURN + 1), -np.arange(HALF_TURN, 0, -1)])
"""Turns to the left from 0 up, then to the right: index ``t`` and ``-t`` hold the turns ``t`` and ``-t``."""


_SWEPT = np.arange(-HALF_TURN - SIDE, HALF_TURN + SIDE + 1)
"""Azimuth sectors that turns sweep over, counted from the one that they begin at."""


def _turns(to: Int[np.ndarray, "*#n"], start: Int[np.ndarray, "*#n"]) -> Int[np.ndarray, "*#n"]:
    """Signed turns of 10 degrees from azimuth sectors to others, the shorter way."""
    return (to - start + HALF_TURN) % NUM_AZIMUTHS - HALF_TURN


def _swept(left: Float[np.ndarray, "*n azimuths"], start: Int[np.ndarray, "*n"]) -> Float[np.ndarray, "*n turns"]:
    """What a camera that looks along ``start`` and then turns sees in all, for each turn of ``_TURNS``."""
    rolled = np.take_along_axis(left, (start[..., None] + _SWEPT) % NUM_AZIMUTHS, axis=-1).astype(float)
    middle = rolled[..., HALF_TURN : HALF_TURN + 2 * SIDE + 1].sum(axis=-1, keepdims=True)
    to_left = middle + np.cumsum(rolled[..., HALF_TURN + 2 * SIDE + 1 :], axis=-1)
    to_right = middle + np.cumsum(rolled[..., HALF_TURN - 1 :: -1], axis=-1)
    return np.concatenate([middle, to_left, to_right[..., ::-1]], axis=-1)
