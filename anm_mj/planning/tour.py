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

from anm_mj.planning.paths import Reach, segments_clear
from anm_mj.types import FORWARD_STEP_M, TURN_STEP_RAD

HALF_TURN = 18
"""Turns of 10 degrees in half a turn; azimuth sectors are as wide as one turn."""
NUM_AZIMUTHS = 2 * HALF_TURN
SIDE = 4
"""Sectors to either side of the middle one that a view of 90 degrees takes in."""
VISIBLE_M = 5.0
"""Places farther from one another than this are taken to be joined by the graph alone [m]."""
BEARING_OVER_M = 0.8
"""The direction of arrival is that of the last so many metres [m]."""


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
    def rate(self) -> float:
        """What it brings per step [m2]."""
        return sum(stop.gain_m2 for stop in self.stops) / max(self.stops[-1].at_step, 1.0)


@dataclass(frozen=True)
class _State:
    tour: Tour
    place: int
    heading: int
    steps: float
    factor: float
    """On the worth of all that is gained, from the place the tour begins at."""
    shown: Bool[np.ndarray, " patches"]


class TourSearch:
    """Beam search over sequences of views among a few places."""

    def __init__(
        self, places: Places, reach: Reach, *, discount_steps: float, preferred: Float[np.ndarray, " k"]
    ) -> None:
        """Work out all pairs of ways.

        Args:
            places: where to look from.
            reach: shortest paths from the robot.
            discount_steps: gain had after this many steps counts 1/e.
            preferred: factor on the worth of sequences that begin at each place: hysteresis.
        """
        self._discount_steps = discount_steps
        self._preferred = preferred
        names, patch = np.unique(places.patch, return_inverse=True)
        self._num_patches = len(names)
        self._patch = patch.reshape(len(places.xy_m), NUM_AZIMUTHS, -1)
        self._worth = places.worth.reshape(self._patch.shape)
        self._steps, self._leave, self._arrive = _ways(places, reach)

    def best(self, heading: int, *, depth: int, width: int) -> list[Tour]:
        """The best tours found for a robot that looks along an azimuth sector, best first.

        Args:
            heading: azimuth sector the robot looks along now.
            depth: most stops in a tour.
            width: tours kept at each depth.
        """
        beam = [_State(Tour((), 0.0), 0, heading, 0.0, 1.0, np.zeros(self._num_patches, bool))]
        found: list[Tour] = []
        for _ in range(depth):
            grown = [child for state in beam for child in self._expand(state, 2 * width)]
            grown.sort(key=lambda child: -child[0])
            beam = [self._go(state, *step) for _, state, step in grown[:width]]
            if not beam:
                break
            found += [state.tour for state in beam]
        return sorted(found, key=lambda tour: -tour.value)

    def _expand(self, state: _State, most: int) -> list[tuple[float, _State, tuple[int, int, float, float]]]:
        """The most promising next stops: value, state before, and (place, heading, steps, gain)."""
        left = np.where(state.shown[self._patch], np.float32(0.0), self._worth).sum(axis=2)
        turn_away = _turns(self._leave[state.place], state.heading)
        # Where the robot stays, it only turns; the sweep is then that of the arrival.
        turn_away[state.place] = 0
        here = _swept(left[state.place][None], np.array([state.heading]))[0]
        away = here[turn_away] - here[0]
        arrive = self._arrive[state.place].copy()
        arrive[state.place] = state.heading
        at = _swept(left, arrive)
        steps = self._steps[state.place][:, None] + np.abs(turn_away)[:, None] + np.abs(_TURNS)[None, :]
        gain = away[:, None] + at
        gain[state.place] -= at[state.place, 0]
        late = state.steps + steps
        added = gain * np.exp(-late / self._discount_steps)
        added[steps < 0.5] = 0.0
        added *= state.factor if state.tour.stops else self._preferred[:, None]
        turn = added.argmax(axis=1)
        rows = np.arange(len(turn))
        value = added[rows, turn]
        order = np.argsort(-value, kind="stable")[:most]
        return [
            (
                state.tour.value + float(value[j]),
                state,
                (
                    int(j),
                    int((arrive[j] + _TURNS[turn[j]]) % NUM_AZIMUTHS),
                    float(steps[j, turn[j]]),
                    float(gain[j, turn[j]]),
                ),
            )
            for j in order
            if value[j] > 0.0
        ]

    def _go(self, state: _State, place: int, heading: int, steps: float, gain: float) -> _State:
        shown = state.shown.copy()
        late = state.steps + steps
        if place != state.place:
            self._show(shown, state.place, state.heading, int(self._leave[state.place, place]))
            self._show(shown, place, int(self._arrive[state.place, place]), heading)
        else:
            self._show(shown, place, state.heading, heading)
        factor = state.factor if state.tour.stops else float(self._preferred[place])
        value = state.tour.value + gain * math.exp(-late / self._discount_steps) * factor
        stops = (*state.tour.stops, Stop(place, heading, gain, late))
        return _State(Tour(stops, float(value)), place, heading, late, factor, shown)

    def _show(self, shown: Bool[np.ndarray, " patches"], place: int, start: int, end: int) -> None:
        """Mark what a turn at a place sweeps over."""
        turn = int(_turns(np.array([end]), start)[0])
        low, high = min(turn, 0) - SIDE, max(turn, 0) + SIDE
        sectors = np.arange(start + low, start + high + 1) % NUM_AZIMUTHS
        met = self._patch[place, sectors]
        shown[met[self._worth[place, sectors] > 0.0]] = True


_TURNS = np.concatenate([np.arange(HALF_TURN + 1), -np.arange(HALF_TURN, 0, -1)])
"""Turns to the left from 0 up, then to the right: index ``t`` and ``-t`` hold the turns ``t`` and ``-t``."""


def _turns(to: Int[np.ndarray, " n"], start: int) -> Int[np.ndarray, " n"]:
    """Signed turns of 10 degrees from one azimuth sector to others, the shorter way."""
    return (to - start + HALF_TURN) % NUM_AZIMUTHS - HALF_TURN


def _swept(left: Float[np.ndarray, "k azimuths"], start: Int[np.ndarray, " k"]) -> Float[np.ndarray, "k turns"]:
    """What a camera that looks along ``start`` and then turns sees in all, for each turn of ``_TURNS``."""
    around = (start[:, None] + np.arange(-SIDE - HALF_TURN, SIDE + HALF_TURN + 1)[None, :]) % NUM_AZIMUTHS
    rolled = np.take_along_axis(left, around, axis=1).astype(float)
    middle = rolled[:, HALF_TURN : HALF_TURN + 2 * SIDE + 1].sum(axis=1, keepdims=True)
    to_left = middle + np.cumsum(rolled[:, HALF_TURN + 2 * SIDE + 1 :], axis=1)
    to_right = middle + np.cumsum(rolled[:, HALF_TURN - 1 :: -1], axis=1)
    return np.concatenate([middle, to_left, to_right[:, ::-1]], axis=1)


def _ways(
    places: Places, reach: Reach
) -> tuple[Float[np.ndarray, "k k"], Int[np.ndarray, "k k"], Int[np.ndarray, "k k"]]:
    """Forward steps between places and the azimuth sectors that they are left and come to along.

    Places in sight of one another are joined by a straight line, others by the way along the tree of shortest paths
    from the robot: back to where their paths part and on from there.
    """
    k = len(places.xy_m)
    chains = [[] if v < 0 else reach.chain_to(int(v)) for v in places.vertex]
    from_root = np.array([0.0 if v < 0 else reach.distance_m[v] for v in places.vertex])
    used = sorted({v for chain in chains for v in chain})
    column = {v: i for i, v in enumerate(used)}
    on_way = np.zeros((k, len(used)), np.float32)
    for i, chain in enumerate(chains):
        on_way[i, [column[v] for v in chain]] = 1.0
    depth = on_way * reach.distance_m[used].astype(np.float32)
    parting = np.stack([(depth * row).max(axis=1, initial=0.0) for row in on_way])
    length = np.maximum(from_root[:, None] + from_root[None, :] - 2.0 * parting, 0.0)

    difference = places.xy_m[None, :] - places.xy_m[:, None]
    straight = np.linalg.norm(difference, axis=-1)
    near = np.argwhere(np.triu(straight < VISIBLE_M, 1))
    clear = segments_clear(reach.topdown, places.xy_m[near[:, 0]], places.xy_m[near[:, 1]], reach.safe_m, reach.pose)
    direct = np.zeros((k, k), bool)
    direct[near[clear, 0], near[clear, 1]] = True
    direct |= direct.T
    length = np.where(direct, straight, np.maximum(length, straight))

    bearing = np.arctan2(difference[..., 1], difference[..., 0])
    arrival = np.array([_arrival(reach, chain, xy) for chain, xy in zip(chains, places.xy_m, strict=True)])
    first = np.array([_departure(reach, chain, xy) for chain, xy in zip(chains, places.xy_m, strict=True)])
    leave = np.where(direct, bearing, (arrival + math.pi)[:, None])
    leave[0] = np.where(direct[0], bearing[0], first)
    arrive = np.where(direct, bearing, arrival[None, :])
    arrive[:, 0] = np.where(direct[:, 0], bearing[:, 0], first + math.pi)
    turning = np.abs(np.remainder(arrive - leave + math.pi, math.tau) - math.pi) / TURN_STEP_RAD
    return length / FORWARD_STEP_M + turning, _sector(leave), _sector(arrive)


def _arrival(reach: Reach, chain: list[int], xy_m: Float[np.ndarray, 2]) -> float:
    """Direction in which a path comes to its end [rad]."""
    for v in chain:
        back = xy_m - reach.graph.vertex_xy_m[v]
        if math.hypot(*back) > BEARING_OVER_M:
            return math.atan2(back[1], back[0])
    back = xy_m - reach.pose.xy_m
    return math.atan2(back[1], back[0])


def _departure(reach: Reach, chain: list[int], xy_m: Float[np.ndarray, 2]) -> float:
    """Direction in which a path leaves the robot [rad]."""
    for v in [*chain[::-1]]:
        on = reach.graph.vertex_xy_m[v] - reach.pose.xy_m
        if math.hypot(*on) > BEARING_OVER_M:
            return math.atan2(on[1], on[0])
    on = xy_m - reach.pose.xy_m
    return math.atan2(on[1], on[0])


def _sector(angle_rad: Float[np.ndarray, "k k"]) -> Int[np.ndarray, "k k"]:
    return np.rint(angle_rad / TURN_STEP_RAD).astype(np.int64) % NUM_AZIMUTHS
